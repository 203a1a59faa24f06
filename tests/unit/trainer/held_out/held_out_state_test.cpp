// SPDX-License-Identifier: Apache-2.0
#include "trainer/held_out/held_out_state.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "evaluation/results/result.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

HeldOutScore held_out_score(double success, double spl) {
  return {{success, success / 2, (1 + success) / 2}, {spl, spl / 2, (1 + spl) / 2}};
}

/// Few values, so that equals are common: success in fifths, SPL in quarters of it.
HeldOutScore drawn_score(const RandomStream& random, std::uint32_t draw) {
  const double success = random.below(6, 2 * draw) / 5.0;
  return held_out_score(success, success * random.below(5, 2 * draw + 1) / 4.0);
}

// A bound of the interval of no hits, or of all, may round to the other side of the mean.
TEST(HeldOutState, IntervalsOfAnyCountAreReadBack) {
  for (std::uint64_t n = 1; n <= 2000; ++n)
    for (const std::uint64_t hits : {std::uint64_t{0}, n / 2, n}) {
      const Estimate success = fraction_with_interval(hits, n);
      HeldOutState state{.evaluations = 1, .last_update = 10, .best_update = 10};
      state.set = "0123456789abcdef";
      state.best.success = {success.mean, success.low, success.high};
      EXPECT_EQ(decode_held_out(encode_held_out(state)).best.success.mean, success.mean) << hits << " of " << n;
    }
}

TEST(HeldOutState, TheBestIsTheFirstOfTheHighestSuccessAndOfEqualsOfTheHighestSpl) {
  EXPECT_TRUE(is_better(held_out_score(0.5, 0.1), held_out_score(0.4, 0.4)));
  EXPECT_TRUE(is_better(held_out_score(0.5, 0.3), held_out_score(0.5, 0.2)));
  EXPECT_FALSE(is_better(held_out_score(0.5, 0.3), held_out_score(0.5, 0.3)));
  EXPECT_FALSE(is_better(held_out_score(0.4, 0.4), held_out_score(0.5, 0.1)));
  for (std::uint32_t run = 0; run < 200; ++run) {
    const RandomStream random(run, Purpose::test);
    HeldOutState state;
    std::vector<HeldOutScore> scores;
    for (std::uint32_t i = 0; i < 12; ++i) {
      scores.push_back(drawn_score(random, i));
      state = after_evaluation(state, 10 * (i + 1), {.argmax = {}, .sample = {}, .env_steps = i + 1, .seconds = 0.5}, scores.back());
      // By all of them at once: the first that none exceeds.
      const auto best = std::ranges::max_element(scores, [](const HeldOutScore& a, const HeldOutScore& b) {
        return std::pair(a.success.mean, a.spl.mean) < std::pair(b.success.mean, b.spl.mean);
      });
      const auto place = static_cast<std::uint64_t>(best - scores.begin());
      ASSERT_EQ(state.best_update, 10 * (place + 1)) << run << " " << i;
      ASSERT_EQ(state.best, *best);
      ASSERT_EQ(state.since_best, static_cast<int>(i - place));
      for (int patience = 1; patience < 6; ++patience)
        ASSERT_EQ(has_stopped_learning({.every_updates = 10, .patience = patience}, state),
                  i - place >= static_cast<std::uint64_t>(patience));
    }
    EXPECT_EQ(state.evaluations, 12u);
    EXPECT_EQ(state.last_update, 120u);
    EXPECT_EQ(state.env_steps, 78u);
    EXPECT_EQ(state.last_env_steps, 12u);
    EXPECT_EQ(state.seconds, 6);
    EXPECT_EQ(state.last_seconds, 0.5);
  }
}

TEST(HeldOutState, WithoutPatienceOrEvaluationsARunNeverStopsByItself) {
  HeldOutState state;
  state.since_best = 1000;
  EXPECT_FALSE(has_stopped_learning({.every_updates = 1, .patience = 0}, state));
  EXPECT_FALSE(has_stopped_learning({.every_updates = 0, .patience = 1}, state));
}

TEST(HeldOutState, AnEvaluationIsDueOnceForEachMultipleThatWasReached) {
  EXPECT_FALSE(is_due({}, {}, 100));
  for (int every = 1; every < 9; ++every) {
    HeldOutState state;
    std::vector<std::uint64_t> evaluated;
    for (std::uint64_t update = 0; update <= 40; ++update) {
      if (!is_due({.every_updates = every}, state, update)) continue;
      evaluated.push_back(update);
      state.last_update = update;
    }
    std::vector<std::uint64_t> multiples;
    for (std::uint64_t update = static_cast<std::uint64_t>(every); update <= 40; update += static_cast<std::uint64_t>(every))
      multiples.push_back(update);
    EXPECT_EQ(evaluated, multiples) << every;
  }
  // One that had to wait comes as soon as it may, and the next at its own time.
  HeldOutState late;
  late.last_update = 10;
  EXPECT_TRUE(is_due({.every_updates = 10}, late, 23));
  late.last_update = 23;
  EXPECT_FALSE(is_due({.every_updates = 10}, late, 29));
  EXPECT_TRUE(is_due({.every_updates = 10}, late, 30));
}

// Each evaluation costs 18 to 20, so that it is up to 2 more than the one before by which it was foreseen.
TEST(HeldOutState, TheFractionOfEvaluationsIsBounded) {
  for (std::uint32_t run = 0; run < 50; ++run) {
    const RandomStream random(run, Purpose::test, 1);
    const double most = 0.02 + 0.5 * static_cast<double>(random.uniform(0));
    double spent = 0, last = 0, training = 0;
    int evaluations = 0;
    for (std::uint32_t update = 1; update < 400; ++update) {
      training += 1 + static_cast<double>(random.uniform(2 * update));
      if (!is_within_fraction(most, spent, last, training)) continue;
      last = 18 + 2 * static_cast<double>(random.uniform(2 * update + 1));
      spent += last;
      if (++evaluations > 1) {
        ASSERT_LE(spent, most * (spent + training) + 2) << run << " " << update;
      }
    }
    EXPECT_GT(evaluations, 0);
    EXPECT_GT(spent + 20, most * (spent + 20 + training - 2) - 2) << "no more is left out than has to be";
  }
}

TEST(HeldOutState, AnotherSetKeepsTheCostsAlone) {
  HeldOutState state =
      after_evaluation(state_for_set({}, "a"), 7, {.argmax = {}, .sample = {}, .env_steps = 9, .seconds = 2}, held_out_score(1, 1));
  EXPECT_EQ(state_for_set(state, "a"), state);
  const HeldOutState other = state_for_set(state, "b");
  EXPECT_EQ(other.best_update, 0u);
  EXPECT_EQ(other.best, HeldOutScore{});
  EXPECT_EQ(other.env_steps, 9u);
  EXPECT_EQ(other.last_update, 7u);
  EXPECT_EQ(other.set, "b");
}

TEST(HeldOutState, ItsTextGivesItBackToTheLastBit) {
  EXPECT_EQ(decode_held_out(encode_held_out({})), HeldOutState{});
  for (std::uint32_t run = 0; run < 500; ++run) {
    const RandomStream random(run, Purpose::test, 2);
    HeldOutState state = state_for_set({}, "0123456789abcdef");
    for (std::uint32_t i = 0; i < 3; ++i) {
      const double success = static_cast<double>(random.uniform(3 * i)) / 3, spl = success * static_cast<double>(random.uniform(3 * i + 1));
      state =
          after_evaluation(state, 5 * (i + 1), {.argmax = {}, .sample = {}, .env_steps = random.bits(3 * i + 2), .seconds = success / 7},
                           held_out_score(success, spl));
    }
    ASSERT_EQ(decode_held_out(encode_held_out(state)), state) << encode_held_out(state);
  }
}

TEST(HeldOutState, AnotherTextIsRefused) {
  const HeldOutState state =
      after_evaluation(state_for_set({}, "a"), 7, {.argmax = {}, .sample = {}, .env_steps = 9, .seconds = 2}, held_out_score(0.5, 0.25));
  const std::string text = encode_held_out(state);
  ASSERT_EQ(decode_held_out(text), state);
  for (std::size_t cut = 0; cut < text.rfind(' '); ++cut) EXPECT_THROW(decode_held_out(text.substr(0, cut)), RunError) << cut;
  EXPECT_THROW(decode_held_out(text + " 1"), RunError);
  for (const auto& [from, to] : {std::pair("7 7", "7 8"), std::pair("0.5 ", "nan "), std::pair("0.5 ", "-1 "), std::pair("0.5 ", "1e300 "),
                                 std::pair("a 1", "a -x")}) {
    std::string bad = text;
    const std::size_t at = bad.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    bad.replace(at, std::string(from).size(), to);
    EXPECT_THROW(decode_held_out(bad), RunError) << bad;
  }
}

}  // namespace
}  // namespace earshot
