// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "apps/options/print_warning.h"
#include "apps/sound/comparison_svg.h"
#include "apps/sound/measured_json.h"
#include "apps/sound/measured_options.h"
#include "datasets/measured/room_comparison.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/progress.h"
#include "sim/base/text/json.h"
#include "sim/scene/checks/scene_check.h"

namespace earshot {
namespace {

struct ValidateArguments {
  MeasuredOptions measured;
  std::string scene, json, plot;
};

std::string text_of(const ComparedValue& value, const char* unit) {
  if (!value.error) return "-";
  return value.bias ? fmt::format("{:.2f} {} (bias {:+.2f})", *value.error, unit, *value.bias)
                    : fmt::format("{:.2f} {}", *value.error, unit);
}

/// Mean over the places in which both sides have the value.
std::string pair_of(const RoomComparison& comparison, double band_hz, std::optional<double> BandMetrics::*value) {
  double measured = 0, simulated = 0;
  int count = 0;
  for (const ComparedPlace& place : comparison.places)
    for (std::size_t b = 0; b < place.measured.size(); ++b) {
      const auto &from = place.measured[b].metrics.*value, &to = place.simulated[b].metrics.*value;
      if (place.measured[b].centre_hz != band_hz || !from || !to) continue;
      measured += *from, simulated += *to, ++count;
    }
  return count == 0 ? "      -       -" : fmt::format("{:7.2f} {:7.2f}", measured / count, simulated / count);
}

void print(const RoomComparison& comparison) {
  fmt::print("mean over {} places, measured and simulated\n", comparison.places.size());
  fmt::print("               T20, s          C50, dB         DRR, dB\n");
  for (const double band_hz : comparison.bands_hz)
    fmt::print("  {:>6.0f} Hz {} {} {}\n", band_hz, pair_of(comparison, band_hz, &BandMetrics::t20_s),
               pair_of(comparison, band_hz, &BandMetrics::c50_db),
               band_hz < kLowestDrrHz ? "      -       -" : pair_of(comparison, band_hz, &BandMetrics::drr_db));
  fmt::print("mean error: T20 {}, EDT {},\n  DRR {}, C50 {}, decay curves {}\n", text_of(comparison.t20_percent, "%"),
             text_of(comparison.edt_percent, "%"), text_of(comparison.drr_db, "dB"), text_of(comparison.c50_db, "dB"),
             text_of(comparison.decay_db, "dB"));
}

void run_validate(const ValidateArguments& options) {
  const AcousticConfig config = options.measured.config();
  const MeasuredRoom room = options.measured.room();
  const std::string spec = options.scene.empty() ? room.scene : options.scene;
  if (spec.empty()) throw InputError(options.measured.measured, "names no scene", "add --scene SCENE, or the key scene to its places");
  const AcousticScene scene(options.measured.scene(spec), config);
  check_places(scene, room);
  for (const std::string& warning : scene_warnings(scene.scene())) print_warning(warning);
  RoomComparison comparison;
  {
    Progress progress("validate", "responses", room.responses.size());
    comparison = compare_room(scene, room, [&](std::size_t done) { progress.update(done); });
  }
  print(comparison);
  if (!options.plot.empty())
    write_file_atomically(options.plot, comparison_svg(fmt::format("{} beside {}", spec, options.measured.measured), comparison));
  if (options.json.empty()) return;
  OrderedJson report{{"schema_version", 1}, {"scene", spec}, {"measured", options.measured.measured}, {"seed", config.seed}};
  report.update(comparison_json(comparison));
  write_file_atomically(options.json, json_text(report, 1) + "\n");
}

}  // namespace

void add_validate(CLI::App& app) {
  auto options = std::make_shared<ValidateArguments>();
  CLI::App* command = app.add_subcommand("validate", "Compare measured impulse responses of a room with simulated ones at the same places");
  command
      ->add_option("MEASURED", options->measured.measured,
                   "Folder of sound files with places.yaml, a SOFA file (SingleRoomSRIR), or a folder of them")
      ->type_name(kWholeFolder)
      ->required();
  command->add_option("--scene", options->scene, "SCENE of the room (default: the one that the places name)");
  options->measured.add_to(*command, "high");
  command->add_option("--json", options->json, "JSON file to write: decay times and ratios of every place and octave, and mean errors")
      ->type_name(kOutputFile);
  command->add_option("--plot", options->plot, "SVG figure to write: decay times, ratios and decay curves")->type_name(kOutputFile);
  command->callback([options] { run_validate(*options); });
}

}  // namespace earshot
