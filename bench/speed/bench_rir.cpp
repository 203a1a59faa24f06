// SPDX-License-Identifier: Apache-2.0
#include "bench/speed/bench_rir.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "bench/accuracy/error_coverage.h"
#include "bench/measure/bench_scene.h"
#include "bench/measure/converged_reference.h"
#include "envs/hearing/agent_hearing.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/transmission.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/base/process/progress.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

constexpr double kMs = 1e3;

/// Times of one source and its poses on one thread, seconds.
struct SourceTimes {
  double candidates = 0, field = 0, per_response = 0, per_render = 0;
  [[nodiscard]] double per_source() const { return candidates + field; }
  [[nodiscard]] double per_rir() const { return per_response + per_render; }
};

/// One scene under one preset, shared by all measurements.
class RirBench {
 public:
  RirBench(const BenchScene& scene, const RirBenchOptions& options, BenchReport& report)
      : scene_(scene), options_(options), report_(report), fast_(scene.scene, config_of("fast")) {}

  void run() {
    fmt::print("\n{} ({}): {} triangles, RIR {:.1f} s\n", scene_.name, scene_.spec, scene_.scene->mesh().triangles.size(),
               fast_.config().rir_length_s);
    measure_fast();
    measure_moving_source();
    std::fflush(stdout);  // the stages are of use while the truth is still being traced
    measure_high();
    if (options_.scenes.empty()) {
      measure_errors();
    } else {
      measure_errors_against_paths();
    }
    measure_observation();
  }

 private:
  AcousticConfig config_of(const char* preset) const {
    AcousticConfig config = acoustic_preset(preset);
    config.threads = 1;
    config.rir_length_s = 0.f;  // as long as the scene's decay needs
    if (options_.quick) {
      config.rays = std::min(config.rays, 256);
      config.source_rays = std::min(config.source_rays, 256);
      config.early_candidate_rays = std::min(config.early_candidate_rays, 2000);
      config.field_photons = 1024;
      config.rir_length_s = 0.4f;
    }
    return config;
  }

  BenchJson setting(const AcousticScene& acoustics) const {
    const AcousticConfig& config = acoustics.config();
    BenchJson json = {{"scene", scene_.name},
                      {"spec", scene_.spec},
                      {"triangles", scene_.scene->mesh().triangles.size()},
                      {"threads", 1},
                      {"sample_rate_hz", config.sample_rate_hz},
                      {"channels", "binaural"},
                      {"rir_length_s", config.rir_length_s},
                      {"rays", config.rays},
                      {"source_rays", config.source_rays},
                      {"field", uses_source_field(acoustics)},
                      {"repeats", options_.repeats}};
    if (uses_source_field(acoustics)) {
      json["field_cell_m"] = config.field_cell_m;
      json["photons"] = photons_;
      json["field_error"] = config.field_error;
    }
    return json;
  }

  void add(const std::string& name, const std::string& unit, Measured measured, BenchJson json) const {
    report_.add(name, unit, measured, std::move(json));
  }

  /// One source from nothing, and the walk past it.
  SourceTimes time_source() {
    SourceTimes times;
    Stopwatch watch;
    candidates_ = std::make_unique<EarlyCandidates>(fast_, scene_.source());
    times.candidates = watch.wall_s();
    watch = {};
    field_ = uses_source_field(fast_) ? build_source_field(fast_, *candidates_) : nullptr;
    times.field = watch.wall_s();
    if (field_) photons_ = field_->photons();
    EnergyResponse response;
    Rir rir;
    for (const WalkPose& pose : scene_.walk) {
      watch = {};
      compute_energy_response(fast_, *candidates_, field_.get(), pose.ears(), response);
      times.per_response += watch.wall_s();
      watch = {};
      synthesizer_->render(response, pose.heading_rad, {carrier_key(fast_.hash()), pose.ears()}, rir);
      times.per_render += watch.wall_s();
    }
    times.per_response /= static_cast<double>(scene_.walk.size());
    times.per_render /= static_cast<double>(scene_.walk.size());
    return times;
  }

  /// Full responses of a source that walks while the listener stays where the source of the other measurements is: seconds per response.
  double time_moving_source() {
    EnergyResponse response;
    Rir rir;
    const glm::vec3 listener = scene_.source();
    const Stopwatch watch;
    for (const WalkPose& pose : scene_.walk) {
      const EarlyCandidates candidates(fast_, SoundSource{pose.ears()}, SourceMotion::moves);
      compute_energy_response(fast_, candidates, listener, response);
      synthesizer_->render(response, pose.heading_rad, {carrier_key(fast_.hash()), listener, pose.ears()}, rir);
    }
    return watch.wall_s() / static_cast<double>(scene_.walk.size());
  }

  void measure_moving_source() {
    const double first_ms = kMs * time_moving_source();
    std::vector<double> rates;
    for (int i = 0; i < options_.repeats; ++i) rates.push_back(1.0 / time_moving_source());
    BenchJson json = setting(fast_);
    json["field"] = false;
    json["first_walk_ms"] = first_ms;
    add("moving_source_rir_per_s", "1/s", median_of(rates), json);
    fmt::print("  source that moves {:7.3f} ms per RIR, its candidates and traced rays included (first walk {:.3f})\n",
               kMs / median_of(rates).value, first_ms);
  }

  void measure_fast() {
    tables_ = binaural_tables(fast_);
    synthesizer_ = std::make_unique<RirSynthesizer>(tables_);
    time_source();  // warms caches and scratch
    std::vector<SourceTimes> all;
    for (int i = 0; i < options_.repeats; ++i) all.push_back(time_source());
    const auto over = [&](const auto& value) {
      std::vector<double> values;
      for (const SourceTimes& times : all) values.push_back(value(times));
      return median_of(values);
    };
    const double early_ms = time_stage([&](const WalkPose& pose) { candidates_->find_arrivals(fast_, pose.ears(), arrivals_); });
    const double diffraction_ms =
        time_stage([&](const WalkPose& pose) { candidates_->diffraction().find_arrivals(fast_, pose.ears(), arrivals_); });
    const double transmission_ms =
        time_stage([&](const WalkPose& pose) { find_transmitted(fast_, scene_.source(), pose.ears(), arrivals_); });
    const Measured source_ms = over([](const SourceTimes& t) { return kMs * t.per_source(); });
    const Measured rir_ms = over([](const SourceTimes& t) { return kMs * t.per_rir(); });
    const double candidates_ms = over([](const SourceTimes& t) { return kMs * t.candidates; }).value;
    const double field_ms = over([](const SourceTimes& t) { return kMs * t.field; }).value;
    const double render_ms = over([](const SourceTimes& t) { return kMs * t.per_render; }).value;
    const double response_ms = over([](const SourceTimes& t) { return kMs * t.per_response; }).value;
    const double late_ms = std::max(response_ms - early_ms - diffraction_ms - transmission_ms, 0.0);  // the rest of the response
    fmt::print("  per source  {:9.1f} ms   candidates {:.1f}, photon pass {:.1f} ({} photons)\n", source_ms.value, candidates_ms, field_ms,
               photons_);
    fmt::print("  per RIR     {:9.3f} ms   early {:.3f}, diffraction {:.3f}, transmission {:.3f}, {} {:.3f}, synthesis {:.3f}\n",
               rir_ms.value, early_ms, diffraction_ms, transmission_ms, field_ ? "gather" : "trace", late_ms, render_ms);
    BenchJson json = setting(fast_);
    json["per_source_ms"] = source_ms.value;
    json["per_rir_ms"] = rir_ms.value;
    json["stage_ms"] = {{"candidates", candidates_ms},   {"photon_pass", field_ms},         {"early", early_ms},
                        {"diffraction", diffraction_ms}, {"transmission", transmission_ms}, {field_ ? "gather" : "trace", late_ms},
                        {"synthesis", render_ms}};
    for (const int n : {50, 150, 500, 2000}) {
      BenchJson with_n = json;
      with_n["n"] = n;
      add(fmt::format("fast.rir_per_s.n{}", n), "1/s", over([n](const SourceTimes& t) { return n / (t.per_source() + n * t.per_rir()); }),
          with_n);
    }
    json["n"] = "warm";
    add("fast.rir_per_s.warm", "1/s", over([](const SourceTimes& t) { return 1 / t.per_rir(); }), json);
  }

  /// Milliseconds per pose of one stage: median over the repeats.
  template <class Stage>
  double time_stage(const Stage& stage) {
    std::vector<double> values;
    for (int i = 0; i < options_.repeats; ++i) {
      const Stopwatch watch;
      for (const WalkPose& pose : scene_.walk) {
        arrivals_.clear();
        stage(pose);
      }
      values.push_back(kMs * watch.wall_s() / static_cast<double>(scene_.walk.size()));
    }
    return median_of(values).value;
  }

  /// The preset `high` as it is typed: paths from both ends at each pose, no field.
  void measure_high() {
    AcousticConfig config = config_of("high");
    config.rir_length_s = fast_.config().rir_length_s;
    const AcousticScene high(scene_.scene, config);
    RirSynthesizer synthesizer(binaural_tables(high));
    const EarlyCandidates candidates(high, scene_.source());
    std::vector<double> rates;
    std::vector<ConvergedPose> heard;
    for (const WalkPose& pose : scene_.some_poses(3)) {
      ConvergedPose& at = heard.emplace_back();
      at.pose = pose;
      Rir rir;
      const Stopwatch watch;
      compute_energy_response(high, candidates, pose.ears(), at.response);
      synthesizer.render(at.response, pose.heading_rad, carrier_key(fast_.hash()), rir);
      rates.push_back(1 / watch.wall_s());
      add_errors(high, at);
    }
    add("high.rir_per_s", "1/s", median_of(rates), setting(high));
    add("high.rt60_standard_error_pct", "%", median_of({100 * mean_t20_error(heard)}), setting(high));
  }

  /// A field as fine as the error of `high` asks (`--preset high --set field=on`), with a seed of its own: the truth for `fast`; and that
  /// truth against bidirectional paths, which have nothing but the scene in common with it.
  void measure_errors() {
    AcousticConfig config = config_of("high");
    config.rir_length_s = fast_.config().rir_length_s;
    config.time_bin_s = fast_.config().time_bin_s;
    config.field = Switch::on;
    config.seed = fast_.config().seed + 1;
    const AcousticScene high(scene_.scene, config);
    const auto high_tables = binaural_tables(high);
    RirSynthesizer synthesizer(high_tables);
    const std::vector<WalkPose> poses = scene_.some_poses(options_.poses);
    (void)high.field_grid();  // belongs to the scene
    Stopwatch watch;
    const EarlyCandidates candidates(high, scene_.source());
    const auto field = build_source_field(high, candidates);
    const double source_s = watch.wall_s();
    EnergyResponse response;
    Rir rir;
    std::vector<double> rates;
    constexpr int served = 500;
    for (int i = 0; i < options_.repeats; ++i) {
      watch = {};
      for (const WalkPose& pose : poses) {
        compute_energy_response(high, candidates, field.get(), pose.ears(), response);
        synthesizer.render(response, pose.heading_rad, carrier_key(fast_.hash()), rir);
      }
      rates.push_back(served / (source_s + served * watch.wall_s() / static_cast<double>(poses.size())));
    }
    BenchJson json = setting(high);
    json["photons"] = field->photons();
    json["n"] = served;
    json["per_source_ms"] = kMs * source_s;
    add("high_field.rir_per_s", "1/s", median_of(rates), json);
    add("high_field.rt60_standard_error_pct", "%", median_of({100 * field->t20_error()}), json);

    std::vector<ConvergedPose> truth;
    for (const WalkPose& pose : poses) {
      ConvergedPose& at = truth.emplace_back();
      at.pose = pose;
      compute_energy_response(high, candidates, field.get(), pose.ears(), at.response);
    }
    check_truth(high, candidates, truth);
    // The same carriers and head for both, as for a pose rendered in two modes.
    const BenchJson reference = {
        {"reference", "field"}, {"reference_rt60_standard_error_pct", 100 * field->t20_error()}, {"reference_photons", field->photons()}};
    report_errors(high, truth, carrier_key(fast_.hash()), reference);
  }

  /// Bidirectional paths as the truth, which have nothing but the scene in common with a field, heard with carriers of their own.
  void measure_errors_against_paths() {
    AcousticConfig config = config_of("high");
    config.rir_length_s = fast_.config().rir_length_s;
    config.time_bin_s = fast_.config().time_bin_s;
    config.threads = 0;  // the same bits, sooner: this is not timed
    config.field = Switch::off;
    const AcousticScene paths(scene_.scene, config);
    Progress progress("paths of " + scene_.name, "permille", 1000);
    const std::vector<ConvergedPose> truth =
        converge(paths, EarlyCandidates(paths, scene_.source()), scene_.some_poses(std::min(options_.poses, options_.path_poses)),
                 options_.reference_seconds, [&](double fraction) { progress.update(static_cast<std::uint64_t>(1000 * fraction)); });
    const BenchJson reference = {
        {"reference", "paths"}, {"reference_rt60_standard_error_pct", 100 * mean_t20_error(truth)}, {"reference_runs", count_runs(truth)}};
    fmt::print("  paths at {} poses, {} runs in all: standard error of T20 {:.2f} %\n", truth.size(), count_runs(truth),
               100 * mean_t20_error(truth));
    report_errors(paths, truth, carrier_key(fast_.hash()) + 1, reference);
  }

  /// Errors of `fast` against a truth.  The photons of one field err together at all poses: one field is one draw, whatever the number of
  /// poses.
  struct FastErrors {
    std::vector<std::vector<PoseErrors>> of_field;
    std::vector<PoseErrors> all;
    std::vector<double> stated_pct;  ///< by each field, of T20
    ErrorCoverage coverage;
  };

  /// `fast` with fields of several seeds against the truth, which is rendered with the carriers of `truth_key`.
  FastErrors measure_fast_errors(const AcousticScene& high, const std::vector<ConvergedPose>& truth, std::uint64_t truth_key) {
    const int samples = static_cast<int>(std::lround(fast_.config().rir_length_s * fast_.config().sample_rate_hz));
    // The truth is decoded to its end.
    AcousticConfig decoded = fast_.config();
    decoded.late_decode_s = high.config().late_decode_s;
    ResponseListener truth_listener(binaural_tables(AcousticScene(scene_.scene, decoded)), fast_.config().sample_rate_hz, samples);
    ResponseListener fast_listener(tables_, fast_.config().sample_rate_hz, samples);
    std::vector<HeardResponse> heard_truth;
    for (const ConvergedPose& at : truth) heard_truth.push_back(truth_listener.hear(high, at.response, at.pose.heading_rad, truth_key));
    EnergyResponse response;
    FastErrors errors;
    for (int i = 0; i < options_.error_fields; ++i) {
      AcousticConfig preset_config = fast_.config();
      preset_config.seed = fast_.config().seed + static_cast<std::uint64_t>(i == 0 ? 0 : i + 1);  // the next one is the truth's
      const AcousticScene scene(scene_.scene, preset_config);
      const EarlyCandidates own_candidates(scene, scene_.source());
      const auto own_field = uses_source_field(scene) ? build_source_field(scene, own_candidates) : nullptr;
      auto& of_field = errors.of_field.emplace_back();
      for (std::size_t p = 0; p < truth.size(); ++p) {
        compute_energy_response(scene, own_candidates, own_field.get(), truth[p].pose.ears(), response);
        of_field.push_back(
            compare(heard_truth[p], fast_listener.hear(scene, response, truth[p].pose.heading_rad, carrier_key(fast_.hash()))));
        if (own_field)
          errors.coverage.add(of_field.back().values[static_cast<int>(ErrorKind::t20)], own_field->t20_error(), truth[p].t20_error);
      }
      if (own_field) errors.stated_pct.push_back(100 * own_field->t20_error());
      errors.all.insert(errors.all.end(), of_field.begin(), of_field.end());
    }
    return errors;
  }

  /// The mean of one kind of error, with the range over the fields; nothing where no pose has it.
  void add_error(const std::string& name, const std::string& unit, ErrorKind kind, const FastErrors& errors,
                 const BenchJson& field_setting) const {
    const ErrorSummary summary = summarise(errors.all, kind);
    const double scale = scale_of(kind);
    std::vector<double> means;
    for (const auto& of_field : errors.of_field)
      if (const ErrorSummary field_error = summarise(of_field, kind); field_error.count > 0) means.push_back(scale * field_error.mean);
    if (means.empty()) return;
    BenchJson with_spread = field_setting;
    with_spread["range"] = "least and largest mean of one field";
    with_spread["rms"] = scale * summary.rms;
    with_spread["p95"] = scale * summary.p95;
    with_spread["values"] = summary.count;
    with_spread["missing"] = summary.missing;
    with_spread["fields_mean"] = means;
    add(name, unit, {scale * summary.mean, *std::ranges::min_element(means), *std::ranges::max_element(means)}, with_spread);
  }

  void report_errors(const AcousticScene& high, const std::vector<ConvergedPose>& truth, std::uint64_t truth_key,
                     const BenchJson& reference) {
    const FastErrors errors = measure_fast_errors(high, truth, truth_key);
    BenchJson json = setting(fast_);
    json["poses"] = truth.size();
    json["fields"] = options_.error_fields;
    json.update(reference);
    add_error("fast.rt60_error_pct.energy", "%", ErrorKind::t20, errors, json);
    add_error("fast.rt60_error_pct.rir", "%", ErrorKind::rir_to_rir_t20, errors, json);
    add_error("fast.rt60_error_pct.rir_to_energy", "%", ErrorKind::rir_t20, errors, json);
    add_error("fast.drr_error_db", "dB", ErrorKind::drr_db, errors, json);
    if (const ErrorCoverage& coverage = errors.coverage; coverage.poses > 0) {
      const double covered_pct = 100.0 * coverage.covered / coverage.poses;
      json["poses_counted"] = coverage.poses;
      add("fast.rt60_stated_error_pct", "%", median_of(errors.stated_pct), json);
      add("fast.rt60_covered_pct", "%", {covered_pct, covered_pct, covered_pct}, json);
      fmt::print("  fast states {:.2f} % of T20; two of that and of the truth's cover {} of {} places\n",
                 median_of(errors.stated_pct).value, coverage.covered, coverage.poses);
    }
    add_error("fast.edc_rms_db", "dB", ErrorKind::decay_db, errors, json);
  }

  /// The truth against bidirectional path tracing at a few of its poses: difference of their T20, and standard error of the paths.
  void check_truth(const AcousticScene& high, const EarlyCandidates& candidates, const std::vector<ConvergedPose>& truth) const {
    AcousticConfig config = high.config();
    config.threads = 0;  // the same bits, sooner: this is not timed
    config.field = Switch::off;
    const AcousticScene paths(scene_.scene, config);
    std::vector<WalkPose> poses;
    const std::size_t count = std::min<std::size_t>(truth.size(), 4);
    for (std::size_t i = 0; i < count; ++i) poses.push_back(truth[(2 * i + 1) * truth.size() / (2 * count)].pose);
    Progress progress("paths of " + scene_.name, "permille", 1000);
    const std::vector<ConvergedPose> traced = converge(paths, candidates, poses, options_.reference_seconds, [&](double fraction) {
      progress.update(static_cast<std::uint64_t>(1000 * fraction));
    });
    std::vector<double> differences;
    for (std::size_t i = 0; i < count; ++i) {
      const RoomMetrics of_paths = measure(paths, traced[i].response);
      const RoomMetrics of_field = measure(high, truth[(2 * i + 1) * truth.size() / (2 * count)].response);
      for (std::size_t b = 0; b < of_paths.bands.size(); ++b)
        if (of_paths.bands[b].t20_s && of_field.bands[b].t20_s)
          differences.push_back(*of_field.bands[b].t20_s / *of_paths.bands[b].t20_s - 1);
    }
    if (differences.empty()) return;
    double mean = 0, size = 0;
    for (const double difference : differences) {
      mean += 100 * difference / static_cast<double>(differences.size());
      size += 100 * std::fabs(difference) / static_cast<double>(differences.size());
    }
    BenchJson json = setting(paths);
    json["poses"] = count;
    json["runs"] = count_runs(traced);
    json["standard_error_pct"] = 100 * mean_t20_error(traced);
    json["mean_difference_pct"] = mean;
    add("high_field.rt60_difference_to_paths_pct", "%", {size, size, size}, json);
    fmt::print(
        "  field of high against bidirectional paths, T20: {:.2f} % apart, {:+.2f} % in the mean; standard error of the paths {:.2f} %\n",
        size, mean, 100 * mean_t20_error(traced));
  }

  /// The observation of an agent at each step, through the stages that environments run: response, RIR, convolution with the running sound,
  /// spectrogram of the last second.
  void measure_observation() {
    AcousticConfig shared = fast_.config();
    if (field_) shared.field = Switch::on;  // left alone, environments trace: here the source is shared
    SceneCache cache(shared, NavmeshConfig{}, ".", std::size_t{4} << 30);
    const auto source = cache.source(scene_.spec, scene_.scene->to_world(scene_.source_foot), 1.5f);
    const AcousticConfig& config = source->scene->acoustics.config();
    const int block = static_cast<int>(std::lround(0.15f * config.sample_rate_hz));
    const StreamConfig stream{.sample_rate_hz = config.sample_rate_hz,
                              .max_rir_samples = static_cast<int>(std::lround(config.rir_length_s * config.sample_rate_hz)),
                              .max_block_samples = block,
                              .crossfade_samples = 800};
    const SpectrogramConfig shape{.sample_rate_hz = config.sample_rate_hz};
    HearingEngines engines(tables_, stream, shape, make_dry_spectra(stream, 2));
    const LibrarySound dry(synthesize_sound("synth:speech", config.sample_rate_hz));
    std::vector<float> sound(2 * static_cast<std::size_t>(block)), window(2 * static_cast<std::size_t>(shape.num_samples)),
        spectrogram(2 * static_cast<std::size_t>(shape.rows()) * static_cast<std::size_t>(shape.columns()));
    AgentHearing hearing;
    const PlayedSound played{.source = source.get(), .sound = &dry};
    hearing.begin(std::span(&played, 1));
    std::vector<double> rates;
    for (int i = 0; i <= options_.repeats; ++i) {  // the first warms up
      const Stopwatch watch;
      for (const WalkPose& walked : scene_.walk) {
        const Pose pose{.position = walked.foot, .heading_rad = walked.heading_rad};
        hearing.trace(engines, pose, 1.5f, block);
        hearing.synthesize(engines, pose.heading_rad);
        hearing.convolve(engines, block, sound, window);
        hearing.analyze(engines, window, spectrogram, {});
      }
      if (i > 0) rates.push_back(static_cast<double>(scene_.walk.size()) / watch.wall_s());
    }
    add("observation_per_s", "1/s", median_of(rates), setting(fast_));
    fmt::print("  observation {:9.3f} ms   (response, RIR, {} new samples, spectrogram)\n", kMs / median_of(rates).value, block);
  }

  const BenchScene& scene_;
  const RirBenchOptions& options_;
  BenchReport& report_;
  AcousticScene fast_;
  std::shared_ptr<const SynthesisTables> tables_;
  std::unique_ptr<RirSynthesizer> synthesizer_;
  std::unique_ptr<EarlyCandidates> candidates_;
  std::shared_ptr<const SourceField> field_;
  std::vector<Arrival> arrivals_;
  std::uint64_t photons_ = 0;
};

}  // namespace

BenchReport bench_rir(const RirBenchOptions& options) {
  BenchReport report("rir");
  std::vector<SceneName> scenes;
  for (const std::string& spec : options.scenes) scenes.push_back({spec, spec});
  if (scenes.empty() && options.quick) {
    scenes.push_back({"two_rooms", "house:2,rooms=2,area_m2=24"});
  } else if (scenes.empty()) {
    if (const auto found = scene_file("small_house", "small_house.yaml")) scenes.push_back(*found);
    scenes.push_back({"large_house", kLargeHouse});
  }
  std::vector<BenchScene> loaded;  // all of them before the first is measured: one that is wrong costs no time
  for (const auto& [name, spec] : scenes) loaded.push_back(load_bench_scene(name, spec));
  for (const BenchScene& scene : loaded) RirBench(scene, options, report).run();
  return report;
}

}  // namespace earshot
