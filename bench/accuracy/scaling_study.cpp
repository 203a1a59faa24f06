// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/scaling_study.h"

#include <fmt/format.h>
#include <malloc.h>
#include <unistd.h>

#include <fstream>
#include <memory>

#include "bench/measure/bench_scene.h"
#include "bench/measure/converged_reference.h"
#include "bench/measure/measured.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/base/stopwatch.h"

namespace earshot {
namespace {

/// One plan of eight rooms; only its detail differs.
constexpr const char* kHouse = "house:7,rooms=8,area_m2=140";
const char* const kDetails[] = {"", ",detail_m=0.38", ",detail_m=0.12", ",detail_m=0.054"};
constexpr std::size_t kSourcesDetail = 1;  ///< of the house with several sources
constexpr int kRepeats = 5;

AcousticConfig fast_config() {
  AcousticConfig config = acoustic_preset("fast");
  config.threads = 1;
  config.rir_length_s = 0;
  config.field = Switch::on;  // for what the scene grows by; a plan that changes with detail would hide it
  return config;
}

/// Sources of one scene, each with its field, and the responses to all of them.
class HeardSources {
 public:
  explicit HeardSources(const AcousticScene& acoustics)
      : acoustics_(acoustics), tables_(binaural_tables(acoustics)), synthesizer_(tables_) {}

  double add(glm::vec3 source) {
    const Stopwatch watch;
    auto& candidates = candidates_.emplace_back(std::make_unique<EarlyCandidates>(acoustics_, source));
    fields_.push_back(uses_source_field(acoustics_) ? build_source_field(acoustics_, *candidates) : nullptr);
    return 1e3 * watch.wall_s();
  }
  /// Milliseconds per pose, median of the repeats, the first of which warms up and does not count.
  double per_response_ms(const BenchScene& scene) {
    std::vector<double> ms;
    for (int repeat = 0; repeat <= kRepeats; ++repeat) {
      const Stopwatch watch;
      for (const WalkPose& pose : scene.walk)
        for (std::size_t s = 0; s < candidates_.size(); ++s) {
          compute_energy_response(acoustics_, *candidates_[s], fields_[s].get(), pose.ears(), response_);
          synthesizer_.render(response_, pose.heading_rad, carrier_key(scene.scene->hash()), rir_);
        }
      if (repeat > 0) ms.push_back(1e3 * watch.wall_s() / static_cast<double>(scene.walk.size()));
    }
    return median_of(ms).value;
  }

 private:
  const AcousticScene& acoustics_;
  std::shared_ptr<const SynthesisTables> tables_;
  RirSynthesizer synthesizer_;
  std::vector<std::unique_ptr<EarlyCandidates>> candidates_;
  std::vector<std::shared_ptr<const SourceField>> fields_;
  EnergyResponse response_;
  Rir rir_;
};

ScalingRow measure_scene(const std::string& spec) {
  ScalingRow row{.spec = spec};
  {
    const double before = resident_bytes();
    Stopwatch watch;
    const auto scene = std::make_shared<const Scene>(load_scene(spec));
    row.load_ms = 1e3 * watch.wall_s();
    row.triangles = scene->mesh().triangles.size();
    watch = {};
    const AcousticScene acoustics(scene, fast_config());
    static_cast<void>(acoustics.field_grid());
    row.prepare_ms = 1e3 * watch.wall_s();
    row.memory_mb = 1e-6 * (resident_bytes() - before);
  }
  const BenchScene scene = load_bench_scene(spec, spec);
  const AcousticScene acoustics(scene.scene, fast_config());
  static_cast<void>(acoustics.field_grid());
  HeardSources heard(acoustics);
  row.per_source_ms = heard.add(scene.source());
  row.per_rir_ms = heard.per_response_ms(scene);
  return row;
}

std::vector<SourcesRow> measure_sources(const std::string& spec, int most) {
  const BenchScene scene = load_bench_scene(spec, spec);
  const AcousticScene acoustics(scene.scene, fast_config());
  static_cast<void>(acoustics.field_grid());
  HeardSources heard(acoustics);
  const std::vector<WalkPose> places = scene.some_poses(most + 1);
  std::vector<SourcesRow> rows;
  double source_ms = 0;
  for (int s = 1; s <= most; ++s) {
    // The first is that of the other measurements; the others stand along the walk, half a metre above the ears, so that no pose is at one.
    source_ms += heard.add(s == 1 ? scene.source() : places[static_cast<std::size_t>(s)].ears() + glm::vec3(0, 0.5f, 0));
    if ((s & (s - 1)) != 0) continue;  // 1, 2, 4, 8
    rows.push_back({.sources = s, .per_source_ms = source_ms / s, .per_response_ms = heard.per_response_ms(scene)});
  }
  return rows;
}

}  // namespace

double resident_bytes() {
  ::malloc_trim(0);
  std::ifstream statm("/proc/self/statm");
  double all_pages = 0, resident_pages = 0;
  statm >> all_pages >> resident_pages;
  return resident_pages * static_cast<double>(::sysconf(_SC_PAGESIZE));
}

ScalingStudy run_scaling_study(bool quick, const std::function<void(const std::string& stage)>& progress) {
  ScalingStudy study;
  study.sources_spec = kHouse + std::string(quick ? "" : kDetails[kSourcesDetail]);
  for (const char* detail : kDetails) {
    if (quick && study.scenes.size() == 2) break;
    study.scenes.push_back(measure_scene(kHouse + std::string(detail)));
    if (progress) progress(fmt::format("{} triangles", study.scenes.back().triangles));
  }
  study.sources = measure_sources(study.sources_spec, quick ? 2 : 8);
  if (progress) progress("sources");
  return study;
}

std::string scaling_markdown(const ScalingStudy& study) {
  if (study.scenes.empty()) return "";
  std::string text =
      "\n## Cost against triangles and sources\n\nPreset `fast` with a source field on one thread, one house at four details. Memory: "
      "growth of the process by the scene and what is prepared of it.\n\n| SCENE | triangles | load, ms | prepare, ms | memory, MB | per "
      "source, ms | per RIR, ms, warm |\n|---|---|---|---|---|---|---|\n";
  for (const ScalingRow& row : study.scenes)
    text += fmt::format("| `{}` | {} | {:.0f} | {:.0f} | {:.0f} | {:.3g} | {:.3g} |\n", row.spec, row.triangles, row.load_ms,
                        row.prepare_ms, row.memory_mb, row.per_source_ms, row.per_rir_ms);
  text += fmt::format(
      "\nSeveral sources in `{}`: a response hears all of them.\n\n| sources | per source, ms | per response, ms, warm |\n|---|---|---|\n",
      study.sources_spec);
  for (const SourcesRow& row : study.sources)
    text += fmt::format("| {} | {:.3g} | {:.3g} |\n", row.sources, row.per_source_ms, row.per_response_ms);
  return text;
}

}  // namespace earshot
