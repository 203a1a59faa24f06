// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/held_out_evaluation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <exception>
#include <filesystem>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "evaluation/results/policy_evaluator.h"
#include "evaluation/results/result.h"
#include "sim/base/files.h"
#include "sim/base/process/stop_signals.h"
#include "sim/base/stopwatch.h"
#include "trainer/run/episode_data.h"

namespace earshot {
namespace {

/// Thrown between two steps once a stop signal has come.
struct BrokenOff : std::exception {};

/// An episode on its way to the other workers; they run the same program.
struct RowMessage {
  std::uint64_t episode = 0;
  EpisodeMetrics metrics;
};
static_assert(std::is_trivially_copyable_v<RowMessage>);

void append_rows(std::string& bytes, const EvaluationResult& result, const EvaluationPart& part, int num_envs) {
  for (std::size_t i = 0; i < result.episodes.size(); ++i) {
    if (!part.has(i, num_envs)) continue;
    const RowMessage message{i, result.episodes[i].metrics};
    bytes.append(reinterpret_cast<const char*>(&message), sizeof(message));
  }
}

HeldOutScore score_of(const EvaluationResult& result) {
  const auto estimate = [](const Estimate& e) { return HeldOutEstimate{e.mean, e.low, e.high}; };
  return {estimate(result.success()), estimate(result.spl())};
}

class SplitEvaluation : public HeldOutEvaluator {
 public:
  explicit SplitEvaluation(const RunConfig& config) : env_(config.env) {
    evaluation_.episodes = config.held_out_data.file;
    evaluation_.generator = expected_generator(config.held_out_data, config.env);
    evaluation_.num_envs = config.eval_envs;
    evaluation_.threads = config.env.threads;
    evaluation_.set = load_evaluated_set(evaluation_);
    env_.stage_limit_s = 0;  // which would end other episodes under another load
    env_.order = EpisodeOrder::once;
    if (env_.quarantine_dir.empty()) env_.quarantine_dir = (std::filesystem::path(config.out) / "quarantine").string();
    identity_ =
        hex64(hash64(fmt::format("{} {} {}", hex64(evaluation_.set->hash), config.eval_envs, static_cast<int>(config.eval_actions))));
  }

  [[nodiscard]] const std::string& identity() const override { return identity_; }

  [[nodiscard]] std::optional<HeldOutScores> evaluate(const PolicyNetwork& policy, Collective& collective) override {
    const auto [rank, world_size] = collective.identity();
    evaluation_.part = EvaluationPart{.part = rank, .parts = world_size, .on_step = [&collective] {
                                        collective.note_progress();
                                        if (StopSignals::received()) throw BrokenOff();
                                      }};
    std::string local_part;
    try {
      local_part = run_part(policy);
    } catch (const BrokenOff&) {  // the others are told
    }
    return scores_of(collective.all_gather(local_part));
  }

 private:
  /// Seconds, then the rows of this worker: first those of the likeliest actions, then those of sampled ones.
  std::string run_part(const PolicyNetwork& policy) {
    const Stopwatch watch;
    if (!evaluation_.scenes) evaluation_.scenes = make_scene_cache(env_);
    std::string rows;
    for (const ActionChoice actions : {ActionChoice::argmax, ActionChoice::sample})
      append_rows(rows, evaluate_policy(policy, env_, actions, evaluation_, "held out"), *evaluation_.part, batch());
    const double seconds = watch.wall_s();
    return std::string(reinterpret_cast<const char*>(&seconds), sizeof(seconds)) + rows;
  }

  [[nodiscard]] std::optional<HeldOutScores> scores_of(const std::vector<std::string>& parts) const {
    const std::vector<Episode>& episodes = evaluation_.set->episodes;
    EvaluationResult argmax, sample;
    for (EvaluationResult* result : {&argmax, &sample}) {
      result->episodes.resize(episodes.size());
      for (std::size_t i = 0; i < episodes.size(); ++i) result->episodes[i].scene = episodes[i].scene_id;
    }
    HeldOutScores scores;
    for (std::size_t rank = 0; rank < parts.size(); ++rank) {
      if (parts[rank].empty()) return std::nullopt;
      scores.seconds =
          std::max(scores.seconds, add_part(parts[rank], static_cast<int>(rank), static_cast<int>(parts.size()), argmax, sample));
    }
    for (const EvaluationResult* result : {&argmax, &sample})
      for (const auto& row : result->episodes) scores.env_steps += static_cast<std::uint64_t>(std::max(0, row.metrics.steps));
    scores.argmax = score_of(argmax);
    scores.sample = score_of(sample);
    return scores;
  }

  /// Returns the seconds of that worker.
  double add_part(const std::string& bytes, int rank, int world_size, EvaluationResult& argmax, EvaluationResult& sample) const {
    const EvaluationPart part{.part = rank, .parts = world_size};
    const std::size_t num_episodes = argmax.episodes.size();
    std::size_t rows = 0;
    for (std::size_t i = 0; i < num_episodes; ++i) rows += part.has(i, batch()) ? 1 : 0;
    double seconds = 0;
    if (bytes.size() != sizeof(seconds) + 2 * rows * sizeof(RowMessage))
      throw RunError("the held-out evaluation", fmt::format("worker {} has run other episodes than its part", rank));
    std::memcpy(&seconds, bytes.data(), sizeof(seconds));
    for (std::size_t i = 0; i < 2 * rows; ++i) {
      RowMessage message;
      std::memcpy(&message, bytes.data() + sizeof(seconds) + i * sizeof(message), sizeof(message));
      if (message.episode >= num_episodes || !part.has(message.episode, batch()))
        throw RunError("the held-out evaluation", fmt::format("worker {} has run other episodes than its part", rank));
      (i < rows ? argmax : sample).episodes[message.episode].metrics = message.metrics;
    }
    return seconds;
  }

  [[nodiscard]] int batch() const { return evaluation_batch(evaluation_, evaluation_.set->episodes.size()); }

  EnvConfig env_;
  EvaluationConfig evaluation_;
  std::string identity_;
};

}  // namespace

std::unique_ptr<HeldOutEvaluator> make_held_out_evaluator(const RunConfig& config) {
  return config.held_out.is_on() ? std::make_unique<SplitEvaluation>(config) : nullptr;
}

}  // namespace earshot
