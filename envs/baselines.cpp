#include "envs/baselines.h"

#include <algorithm>
#include <cmath>

#include "sim/base/random.h"

namespace earshot {
namespace {

// The greedy agent's numbers.  Levels are of the louder ear per unit of EnvConfig::sound_gain.  Most synthetic sounds have an RMS near -19
// dB; in four furnished houses they were heard at -34.6 dB (median) between 0.5 and 1 m from the goal, and at -43 dB at 3 m.
constexpr double kStopLevel_db = -34;
constexpr double kTurnDifference_db = 2;
constexpr double kSilence_db = -110;
constexpr float kNear_m = 0.35f;
/// Steps for which it keeps to one side around obstacles, and to the louder ear or to exploring.
constexpr int kPatience_steps = 24;
constexpr float kExploration = 0.5f;

std::int32_t as_int(Action action) { return static_cast<std::int32_t>(action); }

double decibels(double power) { return 10.0 * std::log10(std::max(power, 1e-30)); }

/// Mean level at the left and the right ear over the last `count` samples.
struct EarLevels {
  double left_db, right_db;
};

EarLevels ear_levels(const BatchedEnv& env, std::size_t row, std::size_t count) {
  const std::size_t samples = env.heard().size() / (2 * static_cast<std::size_t>(env.num_rows()));
  const double gain = static_cast<double>(env.config().sound_gain);
  const auto level_db = [&](std::size_t ear) {
    double energy = 0;
    for (const float x : env.heard().subspan((2 * row + ear + 1) * samples - count, count))
      energy += static_cast<double>(x) * static_cast<double>(x);
    return decibels(energy / static_cast<double>(count) / (gain * gain));
  };
  return {level_db(0), level_db(1)};
}

/// Nearest depth in the middle of the picture, in metres.
float clearance_m(const BatchedEnv& env, std::size_t row) {
  const CameraConfig& camera = env.config().observation.camera;
  const auto width = static_cast<std::size_t>(camera.width_px), height = static_cast<std::size_t>(camera.height_px);
  const auto image = env.depth().subspan(row * width * height, width * height);
  float nearest = 1.f;
  for (std::size_t y = height / 4; y < 3 * height / 4; ++y)
    for (std::size_t x = width / 3; x < width - width / 3; ++x) nearest = std::min(nearest, image[y * width + x]);
  return nearest * camera.max_depth_m;
}

Action greedy_action(const BatchedEnv& env, std::size_t row, const RandomStream& whim) {
  const bool hears = !env.heard().empty(), sees = !env.depth().empty();
  EarLevels now{kSilence_db, kSilence_db};
  if (hears) {
    const std::size_t num_rows = 2 * static_cast<std::size_t>(env.num_rows());
    const std::size_t window = env.heard().size() / num_rows, two_steps = std::min(window, 2 * env.audiogoal().size() / num_rows);
    // Sounds pause: the level is that of the whole second.  The side is that of the newest sound, heard since the last turns.
    const EarLevels second = ear_levels(env, row, window);
    if (std::max(second.left_db, second.right_db) > kStopLevel_db) return Action::stop;
    now = ear_levels(env, row, two_steps);
  }
  const Action side = whim.uniform(1) < 0.5f ? Action::left : Action::right;
  if (env.collided()[row] || (sees && clearance_m(env, row) < kNear_m)) return side;
  // Sound is diffracted around obstacles that an agent cannot cross: at times it follows the free space and not the louder ear.
  const bool explores = whim.uniform(0) < kExploration;
  const double difference_db = now.left_db - now.right_db;
  if (!explores && std::max(now.left_db, now.right_db) > kSilence_db && std::abs(difference_db) > kTurnDifference_db)
    return difference_db > 0 ? Action::left : Action::right;
  return Action::forward;
}

}  // namespace

std::optional<Baseline> baseline_by_name(std::string_view name) {
  if (name == "random") return Baseline::random;
  if (name == "greedy") return Baseline::greedy;
  if (name == "oracle") return Baseline::oracle;
  return std::nullopt;
}

void baseline_actions(Baseline baseline, const BatchedEnv& env, std::uint64_t seed, int first_env, std::span<std::int32_t> actions) {
  EARSHOT_EXPECT(actions.size() == static_cast<std::size_t>(env.num_rows()));
  for (std::size_t row = 0; row < actions.size(); ++row) {
    const int index = static_cast<int>(row);
    actions[row] = as_int(Action::stop);
    if (!env.active()[row]) continue;
    const auto id = static_cast<std::uint32_t>(first_env + index), episode = static_cast<std::uint32_t>(env.episode_count(index));
    const int step = env.episode_step(index);
    switch (baseline) {
      case Baseline::random:
        actions[row] = static_cast<std::int32_t>(
            RandomStream(seed, Purpose::random_agent, id, episode, static_cast<std::uint32_t>(step)).below(kNumActions, 0));
        break;
      case Baseline::greedy:
        actions[row] = as_int(greedy_action(
            env, row, RandomStream(seed, Purpose::random_agent, id, episode, static_cast<std::uint32_t>(step / kPatience_steps))));
        break;
      case Baseline::oracle:
        actions[row] = as_int(oracle_action(env.config().task, env.goal(index), env.pose(index)));
        break;
    }
  }
}

}  // namespace earshot
