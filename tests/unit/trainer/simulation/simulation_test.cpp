// SPDX-License-Identifier: Apache-2.0
// Workers over a simulated network and clock (tests/support/simulation).  A seed is tried again by
//   EARSHOT_SEED=N test_trainer_simulation --gtest_filter=Simulation.OneSeed
// which prints its schedule of faults; EARSHOT_SCHEDULE=FILE plays another one (fault_schedule.h).
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <cctype>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <map>
#include <string>

#include "sim/base/errors.h"
#include "tests/support/simulation/simulated_run.h"

namespace earshot::simulation {
namespace {

/// Without the log of the workers, but for one seed.
class Simulation : public testing::Test {
 protected:
  void SetUp() override { spdlog::set_level(spdlog::level::off); }
  void TearDown() override { spdlog::set_level(spdlog::level::info); }
};

std::uint64_t number_of(const char* variable, std::uint64_t otherwise) {
  const char* const text = std::getenv(variable);
  return text == nullptr ? otherwise : std::strtoull(text, nullptr, 10);
}

/// How the processes of many runs ended, and what befell them.
struct Totals {
  std::map<std::string, int> outcomes;
  std::uint64_t messages = 0;
  int changes = 0, joins = 0, must_go_on = 0;
};

/// Failures of one seed, as lines.
std::string failures_of(std::uint64_t seed, Totals& totals) {
  const Scenario scenario = scenario_of(seed);
  const RunReport report = run_scenario(scenario);
  for (std::string outcome : report.outcomes) {
    outcome = outcome.substr(outcome.find("rank"));
    std::string kind;
    for (const char c : outcome)
      if (std::isdigit(static_cast<unsigned char>(c)) == 0)
        kind += c;
      else if (!kind.ends_with('N'))
        kind += 'N';
    ++totals.outcomes[kind];
  }
  totals.messages += report.messages;
  totals.changes += report.changes;
  totals.joins += report.joins;
  totals.must_go_on += report.must_go_on && !scenario.faults.empty() ? 1 : 0;
  if (report.failures.empty()) return {};
  std::string text = describe(scenario);
  for (const auto& failure : report.failures) text += "  FAILS: " + failure + "\n";
  for (const auto& outcome : report.outcomes) text += "  " + outcome + "\n";
  return text;
}

void try_seeds(std::uint64_t first, std::uint64_t count) {
  const std::clock_t began = std::clock();
  int failed = 0;
  Totals totals;
  for (std::uint64_t seed = first; seed < first + count && failed < 20; ++seed) {
    const std::string failures = failures_of(seed, totals);
    if (failures.empty()) continue;
    ++failed;
    ADD_FAILURE() << failures;
  }
  const double seconds = static_cast<double>(std::clock() - began) / CLOCKS_PER_SEC;
  for (const auto& [outcome, times] : totals.outcomes) std::printf("%7d %s\n", times, outcome.c_str());
  std::printf("%llu messages, %d changes of membership, %d joins, %d runs that had to go on\n",
              static_cast<unsigned long long>(totals.messages), totals.changes, totals.joins, totals.must_go_on);
  std::printf("%llu seeds in %.1f s of one core, %.0f a minute\n", static_cast<unsigned long long>(count), seconds,
              60 * static_cast<double>(count) / seconds);
}

TEST_F(Simulation, SomeSeeds) { try_seeds(number_of("EARSHOT_SEED", 1), number_of("EARSHOT_SEEDS", 1000)); }

TEST_F(Simulation, ManySeeds) { try_seeds(number_of("EARSHOT_SEED", 1), number_of("EARSHOT_SEEDS", 100000)); }

// Each was a defect, or shows how near a rule is to its limit.
TEST_F(Simulation, SeedsThatFailed) {
  for (const std::uint64_t seed : {5, 21, 204, 354, 469, 549, 1090, 2650, 6339, 7880, 13445, 21716}) {
    try_seeds(seed, 1);
  }
}

TEST_F(Simulation, ASchedulePlaysAgainFromItsText) {
  int with_faults = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Scenario scenario = scenario_of(seed);
    const RunReport first = run_scenario(scenario);
    scenario.faults = decode_schedule(encode_schedule(scenario.faults), "schedule");
    EXPECT_EQ(run_scenario(scenario).outcomes, first.outcomes) << seed;
    with_faults += scenario.faults.empty() ? 0 : 1;
  }
  EXPECT_GT(with_faults, 10);
  EXPECT_THROW(static_cast<void>(decode_schedule("kill rank=0 at=3", "s")), InputError);
  EXPECT_THROW(static_cast<void>(decode_schedule("kill rank=0 at_s=3x", "s")), InputError);
  EXPECT_THROW(static_cast<void>(decode_schedule("burn rank=0", "s")), InputError);
}

// Two calls of an update have no work between them: that of the end, and the one before it.  So each update takes a delay longer at least.
TEST_F(Simulation, ADelayedLinkSlowsARunAndCostsNoWorker) {
  const auto ended_s = [](const RunReport& report) { return std::stod(report.outcomes.back()); };
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Scenario scenario = scenario_of(seed);
    scenario.faults.clear();
    const double plain_s = ended_s(run_scenario(scenario));
    for (const double delay_s : {0.03, 0.06}) {
      scenario.faults = decode_schedule(fmt::format("delay rank=0 amount={} at_s=0 duration_s=200", delay_s), "schedule");
      const RunReport report = run_scenario(scenario);
      EXPECT_TRUE(report.failures.empty()) << seed;
      EXPECT_EQ(report.finished, scenario.world_size) << seed;
      EXPECT_GT(ended_s(report), plain_s + delay_s * scenario.updates) << seed;
    }
    scenario.faults = decode_schedule("lose rank=1 amount=0.2 at_s=0 duration_s=200", "schedule");
    const RunReport report = run_scenario(scenario);
    EXPECT_EQ(report.finished, scenario.world_size) << seed;
    EXPECT_GT(ended_s(report), plain_s) << seed;
  }
}

TEST_F(Simulation, ASeedGivesTheSameRunEachTime) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const RunReport first = run_scenario(scenario_of(seed)), second = run_scenario(scenario_of(seed));
    EXPECT_EQ(first.outcomes, second.outcomes) << seed;
    EXPECT_EQ(first.messages, second.messages) << seed;
  }
}

TEST_F(Simulation, ASumThatIsAddedTwiceIsSeen) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Scenario scenario = scenario_of(seed);
    scenario.faults.clear();
    EXPECT_TRUE(run_scenario(scenario).failures.empty()) << seed;
    scenario.adds_twice = static_cast<int>(seed) % scenario.world_size;
    EXPECT_FALSE(run_scenario(scenario).failures.empty()) << seed;
  }
}

TEST_F(Simulation, OneSeed) {
  Scenario scenario = scenario_of(number_of("EARSHOT_SEED", 1));
  spdlog::set_level(spdlog::level::info);
  if (const char* const file = std::getenv("EARSHOT_SCHEDULE")) scenario.faults = read_schedule(file);
  std::printf("%s", describe(scenario).c_str());
  const RunReport report = run_scenario(scenario);
  for (const auto& outcome : report.outcomes) std::printf("  %s\n", outcome.c_str());
  std::printf("  %llu messages, %d finished, %d changes, %d joins, longest gap %.2f s\n", static_cast<unsigned long long>(report.messages),
              report.finished, report.changes, report.joins, report.longest_gap_s);
  for (const auto& failure : report.failures) ADD_FAILURE() << failure;
}

}  // namespace
}  // namespace earshot::simulation
