#include "bench/accuracy_study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <thread>
#include <tuple>

#include "bench/converged_reference.h"
#include "bench/measured.h"
#include "envs/baselines.h"
#include "envs/batched_env.h"
#include "envs/episode_generator.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/base/progress.h"

namespace earshot {
namespace {

constexpr int kTwoThreads = 2;

/// Seconds that parts of the study may take.
struct Budget {
  double truth_s, mode_s, env_s;
};

struct StudyScene {
  std::string name, spec;
};

std::vector<StudyScene> study_scenes(bool quick) {
  if (quick) return {{"shoebox", "shoebox:6x3x5@0.15"}, {"two rooms", "house:2,rooms=2,area_m2=24"}};
  std::vector<StudyScene> scenes{{"shoebox", "shoebox:6x3x5@0.15"}, {"house", "house:1,rooms=4,area_m2=60"}, {"large house", kLargeHouse}};
  const auto add_file = [&](const std::string& name, const std::string& file) {
    if (const auto found = scene_file(name, file)) scenes.push_back({found->name, found->spec});
  };
  add_file("small_house", "small_house.yaml");
  add_file("bathroom", "bathroom.yaml");
  add_file("open", "ground_and_wall.yaml");
  scenes.push_back({"corridor", "shoebox:30x2.7x2@gypsum_board,gypsum_board,wood_parquet,plaster_ceiling,gypsum_board,gypsum_board"});
  return scenes;
}

/// Runs modes in one scene.
class SceneStudy {
 public:
  SceneStudy(const StudyScene& scene, const Budget& budget, int num_poses)
      : scene_(load_bench_scene(scene.name, scene.spec)), budget_(budget), poses_(scene_.some_poses(num_poses)) {}

  SceneFacts make_truth(bool quick, const std::function<void(double)>& progress) {
    AcousticConfig config = acoustic_preset("high");
    config.threads = 0;
    config.rir_length_s = 0.f;
    if (quick) config.rays = config.source_rays = 2048;
    high_ = std::make_unique<AcousticScene>(scene_.scene, config);
    const EarlyCandidates candidates(*high_, scene_.source());
    truth_ = converge(*high_, candidates, poses_, budget_.truth_s, progress);
    ResponseListener listener(tables_of(*high_), config.sample_rate_hz, samples_of(*high_));
    SceneFacts facts{.name = scene_.name, .spec = scene_.spec, .triangles = scene_.scene->mesh().triangles.size()};
    double sum_s = 0;
    int count = 0;
    for (const ConvergedPose& pose : truth_) {
      heard_truth_.push_back(listener.hear(*high_, pose.response, pose.pose.heading_rad, noise_key()));
      for (const BandMetrics& band : heard_truth_.back().energy.bands)
        if (band.t20_s) sum_s += *band.t20_s, ++count;
    }
    facts.rt60_s = count > 0 ? sum_s / count : std::nan("");
    facts.truth_error_pct = 100 * mean_t20_error(truth_);
    facts.truth_runs = count_runs(truth_) / static_cast<int>(truth_.size());
    facts.poses = static_cast<int>(truth_.size());
    return facts;
  }

  ModeResult run(const AccuracyMode& mode) {
    ModeResult result{.scene = scene_.name, .sweep = mode.sweep, .value = mode.value, .method = mode.method};
    const AcousticScene acoustics(scene_.scene, mode.config);
    const auto tables = tables_of(acoustics);
    result.rir_length_s = acoustics.config().rir_length_s;
    result.field = uses_source_field(acoustics);
    if (result.field) static_cast<void>(acoustics.field_grid());  // once per scene, not per source
    const Stopwatch watch;
    const EarlyCandidates candidates(acoustics, scene_.source());
    const auto field = result.field ? build_source_field(acoustics, candidates) : nullptr;
    result.per_source_ms = 1e3 * watch.wall_s();
    measure_errors(acoustics, candidates, field.get(), tables, result);
    measure_times(acoustics, candidates, field.get(), tables, result);
    if (mode.sweep == "preset" && mode.value != "high") {
      AcousticConfig config = acoustics.config();
      if (result.field) config.field = Switch::on;  // left alone, environments trace: here all agents have one source
      result.steps_per_s_one = env_steps_per_s(config, 1);
      result.steps_per_s_two = env_steps_per_s(config, kTwoThreads);
    }
    return result;
  }

 private:
  [[nodiscard]] std::uint64_t noise_key() const { return carrier_key(scene_.scene->hash()); }  ///< one for all modes
  static int samples_of(const AcousticScene& scene) {
    return static_cast<int>(std::lround(scene.config().rir_length_s * scene.config().sample_rate_hz));
  }

  /// Tables depend on the bands, the length, the rate and what of the late field is decoded (and the seed, which no mode changes).
  std::shared_ptr<const SynthesisTables> tables_of(const AcousticScene& scene) {
    auto& tables = tables_[{scene.num_bands(), samples_of(scene), scene.config().late_decode_s}];
    if (!tables) tables = binaural_tables(scene);
    return tables;
  }

  void measure_errors(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField* field,
                      const std::shared_ptr<const SynthesisTables>& tables, ModeResult& result) {
    constexpr std::size_t least_poses = 3;
    ResponseListener listener(tables, acoustics.config().sample_rate_hz, samples_of(acoustics));
    EnergyResponse response;
    std::vector<PoseErrors> errors;
    const Stopwatch watch;
    // Where not all poses fit, those that do are spread over the walk: every other one first.
    const std::size_t n = poses_.size();
    for (std::size_t k = 0; k < n && (k < least_poses || watch.wall_s() < 10 * budget_.mode_s); ++k) {
      const std::size_t even = (n + 1) / 2, i = k < even ? 2 * k : 2 * (k - even) + 1;
      compute_energy_response(acoustics, candidates, field, poses_[i].ears(), response);
      errors.push_back(compare(heard_truth_[i], listener.hear(acoustics, response, poses_[i].heading_rad, noise_key())));
    }
    result.poses = static_cast<int>(errors.size());
    for (int kind = 0; kind < kNumErrorKinds; ++kind)
      result.errors[static_cast<std::size_t>(kind)] = summarise(errors, static_cast<ErrorKind>(kind));
  }

  /// Seconds that this thread takes for the poses, from the k-th on and each `stride`-th, until the budget is spent; how many it did.
  int render_some(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField* field, RirSynthesizer& synthesizer,
                  EnergyResponse& response, Rir& rir, std::size_t first, std::size_t stride, double budget_s) const {
    const Stopwatch watch;
    int done = 0;
    for (std::size_t i = first; done == 0 || watch.wall_s() < budget_s; i += stride, ++done) {
      const WalkPose& pose = scene_.walk[i % scene_.walk.size()];
      compute_energy_response(acoustics, candidates, field, pose.ears(), response);
      synthesizer.render(response, pose.heading_rad, noise_key(), rir);
    }
    return done;
  }

  void measure_times(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField* field,
                     const std::shared_ptr<const SynthesisTables>& tables, ModeResult& result) const {
    constexpr int blocks = 5;
    constexpr std::size_t stride = 7;  // prime to the walk's length: every block covers the whole walk
    {
      RirSynthesizer synthesizer(tables);
      EnergyResponse response;
      Rir rir;
      render_some(acoustics, candidates, field, synthesizer, response, rir, 0, stride, 0);  // warms up
      std::vector<double> ms;
      const Stopwatch all;
      for (int b = 0; b < blocks && (b == 0 || all.wall_s() < 2 * budget_.mode_s); ++b) {
        const Stopwatch watch;
        const int done = render_some(acoustics, candidates, field, synthesizer, response, rir, static_cast<std::size_t>(b), stride,
                                     budget_.mode_s / (2 * blocks));
        ms.push_back(1e3 * watch.wall_s() / done);
      }
      result.per_rir_ms = median_of(ms).value;
    }
    std::array<double, kTwoThreads> rates{};
    std::vector<std::thread> threads;
    for (std::size_t t = 0; t < kTwoThreads; ++t)
      threads.emplace_back([&, t] {
        RirSynthesizer synthesizer(tables);
        EnergyResponse response;
        Rir rir;
        const Stopwatch watch;
        const int done = render_some(acoustics, candidates, field, synthesizer, response, rir, t * 3, stride, budget_.mode_s / 4);
        rates[t] = done / watch.wall_s();
      });
    for (std::thread& thread : threads) thread.join();
    result.rirs_per_s_two = rates[0] + rates[1];
  }

  /// Of eight agents that walk to their goals and see and hear.
  double env_steps_per_s(const AcousticConfig& acoustics, int threads) const {
    EnvConfig config;
    config.acoustics = acoustics;
    config.threads = threads;
    const auto scenes = make_scene_cache(config);
    const auto loaded = scenes->scene(scene_.spec);
    const EpisodeFilter near{.min_geodesic_m = 2.f, .max_geodesic_m = 100.f, .min_ratio = 1.f, .max_tries = 1000};
    EpisodeSet set;
    constexpr int num_envs = 8;
    set.episodes = generate_episodes(scene_.spec, *loaded->scene, loaded->navmesh, config.task, near, {"synth:speech"}, 1, 1);
    BatchedEnv env(config, std::make_shared<const EpisodeSet>(std::move(set)), scenes, num_envs);
    env.reset();
    std::vector<std::int32_t> actions(num_envs);
    const Stopwatch watch;
    int steps = 0;
    do {
      baseline_actions(Baseline::random, env, 0, 0, actions);
      for (std::int32_t& action : actions) action = std::max(action, 1);  // no agent stops: the source is the same throughout
      env.step(actions);
      steps += num_envs;
    } while (watch.wall_s() < budget_.env_s);
    return steps / watch.wall_s();
  }

  BenchScene scene_;
  Budget budget_;
  std::vector<WalkPose> poses_;
  std::unique_ptr<AcousticScene> high_;
  std::vector<ConvergedPose> truth_;
  std::vector<HeardResponse> heard_truth_;
  std::map<std::tuple<int, int, float>, std::shared_ptr<const SynthesisTables>> tables_;
};

}  // namespace

AccuracyStudy run_accuracy_study(const AccuracyOptions& options) {
  const std::vector<AccuracyMode> modes = accuracy_modes(options.quick);
  const std::vector<StudyScene> scenes = study_scenes(options.quick);
  const auto num_modes = static_cast<double>(modes.size());
  const double all_s = 60 * options.minutes;
  const int num_poses = options.quick ? 4 : 8;

  AccuracyStudy study;
  constexpr std::uint64_t permille = 1000;
  Progress progress("accuracy", "permille", permille);
  const Stopwatch watch;
  constexpr double truth_fraction = 0.45;
  for (std::size_t s = 0; s < scenes.size(); ++s) {
    const auto tell = [&](double fraction, const std::string& what) {
      const double done = (static_cast<double>(s) + std::min(fraction, 1.0)) / static_cast<double>(scenes.size());
      progress.update(static_cast<std::uint64_t>(permille * done), scenes[s].name + ": " + what);
    };
    // What is left is dealt out anew, so that a slow scene takes from those after it and not from the end; never less than a fifth of an
    // equal part.  Two fifths for the truth, a little for environments, the rest for the modes, each of which takes about twice its timing
    // with the photon pass, the preparation of its scene and the comparison.
    const double scene_s =
        std::max((all_s - watch.wall_s()) / static_cast<double>(scenes.size() - s), 0.2 * all_s / static_cast<double>(scenes.size()));
    const Budget budget{.truth_s = 0.4 * scene_s, .mode_s = 0.2 * scene_s / num_modes, .env_s = 0.02 * scene_s};
    SceneStudy scene(scenes[s], budget, num_poses);
    study.scenes.push_back(scene.make_truth(options.quick, [&](double fraction) { tell(truth_fraction * fraction, "truth"); }));
    for (std::size_t m = 0; m < modes.size(); ++m) {
      study.results.push_back(scene.run(modes[m]));
      tell(truth_fraction + (1 - truth_fraction) * static_cast<double>(m + 1) / num_modes, modes[m].sweep + " " + modes[m].value);
    }
    if (options.after_scene) options.after_scene(study);
  }
  return study;
}

}  // namespace earshot
