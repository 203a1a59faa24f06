// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/study_scene.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <future>
#include <optional>

#include "bench/measure/measured.h"
#include "envs/baselines/baselines.h"
#include "envs/batch/batched_env.h"
#include "envs/episodes/episode_generator.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

constexpr std::size_t kTwoThreads = 2;
constexpr std::uint64_t kSecondSeed = 1'000'003;

int samples_of(const AcousticScene& scene) {
  return static_cast<int>(std::lround(scene.config().rir_length_s * scene.config().sample_rate_hz));
}

/// Every stride-th of n from 0 on, ordered by bisection, so that the first k of them are spread over all.
std::vector<std::size_t> spread_out(std::size_t n, std::size_t stride) {
  std::vector<std::size_t> order;
  std::vector<bool> taken(n, false);
  std::size_t step = stride;
  while (step < n) step *= 2;
  for (; step >= stride; step /= 2)
    for (std::size_t i = 0; i < n; i += step)
      if (!taken[i]) taken[i] = true, order.push_back(i);
  return order;
}

/// A field is one draw at all poses: environments of one scene share it, so one cache serves both thread counts.
double steps_per_s(const EnvConfig& config, const std::shared_ptr<SceneCache>& scenes, const std::shared_ptr<const EpisodeSet>& episodes,
                   int num_envs, double seconds) {
  BatchedEnv env(config, episodes, scenes, num_envs);
  env.reset();
  BaselineAgent agent(Baseline::random, config, num_envs, 0);
  std::vector<std::int32_t> actions(static_cast<std::size_t>(num_envs));
  const Stopwatch watch;
  int steps = 0;
  do {
    agent.act(env, actions);
    for (std::int32_t& action : actions) action = std::max(action, 1);  // no agent stops: the source is the same throughout
    env.step(actions);
    steps += num_envs;
  } while (watch.wall_s() < seconds);
  return steps / watch.wall_s();
}

}  // namespace

/// One draw of a mode: a seed, and the source under it.
struct StudyScene::Draw {
  AcousticScene scene;
  EarlyCandidates candidates;
  std::shared_ptr<const SourceField> field;
  double seconds = 0;  ///< candidates and field

  Draw(AcousticScene new_scene, glm::vec3 source) : Draw(std::move(new_scene), source, Stopwatch()) {}

 private:
  Draw(AcousticScene new_scene, glm::vec3 source, const Stopwatch& watch)
      : scene(std::move(new_scene)),
        candidates(scene, source),
        field(uses_source_field(scene) ? build_source_field(scene, candidates) : nullptr),
        seconds(watch.wall_s()) {}
};

struct StudyScene::Rendering {
  std::shared_ptr<const SynthesisTables> tables;
  float sample_rate_hz;
  int samples;
};

StudyScene::StudyScene(const SceneName& scene, int num_poses, int truth_rays)
    : scene_(load_bench_scene(scene.name, scene.spec)), truth_(scene_.scene, scene_.source(), scene_.some_poses(num_poses), truth_rays) {}

std::uint64_t StudyScene::noise_key() const { return carrier_key(scene_.scene->hash()); }

/// Tables depend on the bands, the length, the rate and what of the late field is decoded (and the seed, which no mode changes).
std::shared_ptr<const SynthesisTables> StudyScene::tables_of(const AcousticScene& scene) {
  auto& tables = tables_[{scene.num_bands(), samples_of(scene), scene.config().late_decode_s}];
  if (!tables) tables = binaural_tables(scene);
  return tables;
}

SceneFacts StudyScene::finish_truth() {
  const AcousticScene& acoustics = truth_.acoustics();
  ResponseListener listener(tables_of(acoustics), acoustics.config().sample_rate_hz, samples_of(acoustics));
  SceneFacts facts{.name = scene_.name, .spec = scene_.spec, .triangles = scene_.scene->mesh().triangles.size()};
  double sum_s = 0;
  int count = 0;
  for (std::size_t p = 0; p < truth_.poses().size(); ++p) {
    const double heading_rad = truth_.poses()[p].heading_rad;
    const auto hear = [&](const EnergyResponse& response) { return listener.hear(acoustics, response, heading_rad, noise_key()); };
    heard_.push_back(hear(truth_.mean(p)));
    values_.push_back({truth_values(hear(truth_.half(p, 0))), truth_values(hear(truth_.half(p, 1))), truth_values(heard_.back())});
    for (const BandMetrics& band : heard_.back().energy.bands)
      if (band.t20_s) sum_s += *band.t20_s, ++count;
  }
  facts.rt60_s = count > 0 ? sum_s / count : std::nan("");
  facts.truth_error_pct = 100 * truth_error(values_, ErrorKind::t20);
  facts.truth_rounds = truth_.rounds();
  facts.truth_rays = acoustics.config().rays;
  facts.truth_s = truth_.seconds();
  facts.poses = static_cast<int>(truth_.poses().size());
  facts.bands_hz = acoustics.bands().centre_hz;
  return facts;
}

ModeResult StudyScene::run(const AccuracyMode& mode, const ModeBudget& budget) {
  ModeResult result{.scene = scene_.name, .sweep = mode.sweep, .value = mode.value, .method = mode.method};
  const AcousticScene acoustics(scene_.scene, mode.config);
  const Rendering rendering{tables_of(acoustics), acoustics.config().sample_rate_hz, samples_of(acoustics)};
  result.rir_length_s = acoustics.config().rir_length_s;
  result.field = uses_source_field(acoustics);
  if (result.field) static_cast<void>(acoustics.field_grid());  // once per scene, not per source
  const AcousticConfig& config = acoustics.config();
  const std::array<Draw, 2> draws{Draw(acoustics, scene_.source()),
                                  Draw(acoustics.with_rays(config.rays, config.seed + kSecondSeed), scene_.source())};
  result.per_source_ms = 1e3 * draws[0].seconds;
  result.errors = measure_errors(mode, draws, rendering, budget.errors_s);
  measure_times(draws[0], rendering, budget.timing_s, result);
  if (mode.sweep == "preset" && mode.value != "high") measure_steps(acoustics, budget.env_s, result);
  return result;
}

ModeErrors StudyScene::measure_errors(const AccuracyMode& mode, const std::array<Draw, 2>& draws, const Rendering& rendering,
                                      double budget_s) const {
  constexpr std::size_t least_poses = 3;
  const std::vector<std::size_t> order = spread_out(values_.size(), static_cast<std::size_t>(mode.pose_stride));
  std::vector<std::optional<DrawnValues>> drawn(order.size());
  std::atomic<std::size_t> next{0};
  const Stopwatch watch;
  const auto work = [&] {
    ResponseListener listener(rendering.tables, rendering.sample_rate_hz, rendering.samples);
    EnergyResponse response;
    for (std::size_t k = next++; k < order.size() && (k < least_poses || watch.wall_s() < budget_s); k = next++) {
      const WalkPose& pose = truth_.poses()[order[k]];
      DrawnValues& values = drawn[k].emplace();
      for (std::size_t d = 0; d < draws.size(); ++d) {
        compute_energy_response(draws[d].scene, draws[d].candidates, draws[d].field.get(), pose.ears(), response);
        const HeardResponse heard = listener.hear(draws[d].scene, response, pose.heading_rad, noise_key());
        values[d] = test_values(heard, heard_[order[k]]);
      }
    }
  };
  std::vector<std::future<void>> workers;
  for (std::size_t t = 0; t < kTwoThreads; ++t) workers.push_back(std::async(std::launch::async, work));
  for (std::future<void>& worker : workers) worker.get();

  std::vector<TruthValues> truth;
  std::vector<DrawnValues> test;
  for (std::size_t k = 0; k < order.size(); ++k)
    if (drawn[k]) truth.push_back(values_[order[k]]), test.push_back(std::move(*drawn[k]));
  ModeErrors errors;
  errors.poses = static_cast<int>(truth.size());
  for (const ErrorKind kind : all_error_kinds()) {
    const auto k = static_cast<std::size_t>(kind);
    errors.all[k] = summarise(truth, test, kind);
    if (mode.sweep != "preset") continue;
    errors.sizes[k] = error_sizes(truth, test, kind);
    const std::size_t bands = truth.empty() ? 0 : truth.front().mean.of(kind).size();
    for (std::size_t band = 0; bands > 1 && band < bands; ++band)
      errors.by_band[k].push_back(summarise(truth, test, kind, static_cast<int>(band)));
  }
  return errors;
}

void StudyScene::measure_times(const Draw& draw, const Rendering& rendering, double budget_s, ModeResult& result) const {
  constexpr int blocks = 5;
  constexpr std::size_t stride = 7;  // prime to the walk's length: every block covers the whole walk
  // Takes each stride-th pose until the budget is spent, at least one; returns their number.
  const auto render_some = [&](RirSynthesizer& synthesizer, EnergyResponse& response, Rir& rir, std::size_t first, double seconds) {
    const Stopwatch watch;
    int done = 0;
    for (std::size_t i = first; done == 0 || watch.wall_s() < seconds; i += stride, ++done) {
      const WalkPose& pose = scene_.walk[i % scene_.walk.size()];
      compute_energy_response(draw.scene, draw.candidates, draw.field.get(), pose.ears(), response);
      synthesizer.render(response, pose.heading_rad, noise_key(), rir);
    }
    return done;
  };
  {
    RirSynthesizer synthesizer(rendering.tables);
    EnergyResponse response;
    Rir rir;
    const Stopwatch first;
    render_some(synthesizer, response, rir, 0, 0);  // warms up
    std::vector<double> ms;
    const bool slow = first.wall_s() > budget_s;  // seconds a response: nothing is left to warm
    if (slow) ms.push_back(1e3 * first.wall_s());
    const Stopwatch all;
    for (int b = 0; !slow && b < blocks && (b == 0 || all.wall_s() < budget_s); ++b) {
      const Stopwatch watch;
      const int done = render_some(synthesizer, response, rir, static_cast<std::size_t>(b), 0.6 * budget_s / blocks);
      ms.push_back(1e3 * watch.wall_s() / done);
    }
    result.per_rir_ms = median_of(ms).value;
  }
  std::vector<std::future<double>> rates;
  for (std::size_t t = 0; t < kTwoThreads; ++t)
    rates.push_back(std::async(std::launch::async, [&, t] {
      RirSynthesizer synthesizer(rendering.tables);
      EnergyResponse response;
      Rir rir;
      const Stopwatch watch;
      const int done = render_some(synthesizer, response, rir, t * 3, 0.3 * budget_s);
      return done / watch.wall_s();
    }));
  for (std::future<double>& rate : rates) result.rirs_per_s_two += rate.get();
}

/// Of eight agents that walk to their goals and see and hear.
void StudyScene::measure_steps(const AcousticScene& acoustics, double budget_s, ModeResult& result) const {
  constexpr int num_envs = 8;
  EnvConfig config;
  config.acoustics = acoustics.config();
  if (result.field) config.acoustics.field = Switch::on;  // left alone, environments trace: here all agents have one source
  const auto scenes = make_scene_cache(config);
  const auto loaded = scenes->scene(scene_.spec);
  const EpisodeFilter near{.min_geodesic_m = 2.f, .max_geodesic_m = 100.f, .min_ratio = 1.f, .max_tries = 1000};
  EpisodeSet set;
  set.episodes = generate_episodes(scene_.spec, *loaded->scene, loaded->navmesh,
                                   {.task = config.task, .filter = near, .sounds = {"synth:speech"}, .count = 1, .seed = 1});
  const auto episodes = std::make_shared<const EpisodeSet>(std::move(set));
  config.threads = 1;
  result.steps_per_s_one = steps_per_s(config, scenes, episodes, num_envs, budget_s);
  config.threads = static_cast<int>(kTwoThreads);
  result.steps_per_s_two = steps_per_s(config, scenes, episodes, num_envs, budget_s);
}

}  // namespace earshot
