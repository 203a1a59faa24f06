// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/commands.h"
#include "apps/options/output_options.h"
#include "apps/options/print_warning.h"
#include "apps/sound/measured_json.h"
#include "apps/sound/measured_options.h"
#include "datasets/measured/material_fit.h"
#include "datasets/measured/room_comparison.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/progress.h"
#include "sim/base/text/json.h"
#include "sim/scene/checks/scene_check.h"

namespace earshot {
namespace {

struct FitArguments {
  MeasuredOptions measured;
  MaterialFitConfig fit;
  std::string out, json;
  int folds = 0;
  bool keep_scattering = false;
};

void print(const FittedRoom& fitted) {
  for (const FittedMaterial& material : fitted.materials) {
    const auto line = [](const char* name, const std::vector<FittedCoefficient>& coefficients) {
      fmt::print("    {:<11}", name);
      for (const FittedCoefficient& coefficient : coefficients)
        fmt::print("  {:.3f} +- {:.3f}", coefficient.value, coefficient.standard_error);
      fmt::print("\n");
    };
    fmt::print("  {}\n", material.name);
    line("absorption", material.absorption);
    if (!material.scattering.empty()) line("scattering", material.scattering);
  }
}

std::string text_of(const RoomComparison& comparison) {
  const auto value = [](const ComparedValue& mean, const char* unit) {
    return mean.error ? fmt::format("{:.2f} {}", *mean.error, unit) : std::string("-");
  };
  return fmt::format("T20 {}, DRR {}, C50 {}, decay curves {}", value(comparison.t20_percent, "%"), value(comparison.drr_db, "dB"),
                     value(comparison.c50_db, "dB"), value(comparison.decay_db, "dB"));
}

/// The responses at these places.
MeasuredRoom part_of(const MeasuredRoom& room, const std::vector<std::size_t>& places) {
  MeasuredRoom part = room;
  part.responses.clear();
  for (const std::size_t place : places) part.responses.push_back(room.responses[place]);
  return part;
}

/// Every place predicted by materials that were fitted without it.
RoomComparison cross_validate(const std::shared_ptr<const Scene>& scene, const AcousticConfig& config, const MeasuredRoom& room,
                              const FitArguments& options) {
  RoomComparison all;
  const auto folds = static_cast<std::size_t>(options.folds);
  for (std::size_t fold = 0; fold < folds; ++fold) {
    std::vector<std::size_t> fitted_to, held_out;
    for (std::size_t place = 0; place < room.responses.size(); ++place) (place % folds == fold ? held_out : fitted_to).push_back(place);
    Progress progress(fmt::format("fold {} of {}", fold + 1, folds), "simulations", 1000);
    const FittedRoom fitted = fit_materials(scene, config, room, options.fit, fitted_to, [&](std::size_t done, std::size_t total) {
      progress.update(std::min<std::uint64_t>(1000, 1000 * done / total));
    });
    const AcousticScene changed(with_materials(*scene, fitted), config);
    RoomComparison part = compare_room(changed, part_of(room, held_out));
    all.bands_hz = part.bands_hz;
    for (ComparedPlace& place : part.places) all.places.push_back(std::move(place));
  }
  summarize(all);
  return all;
}

void run_fit(FitArguments options) {
  options.fit.fit_scattering = !options.keep_scattering;
  const AcousticConfig config = options.measured.config();
  if (config.bands != 0) throw InputError("--set bands", "is set: materials are fitted in octaves", "leave it out");
  const MeasuredRoom room = options.measured.room();
  if (options.folds > static_cast<int>(room.responses.size()))
    throw InputError("--folds", fmt::format("is {} for {} responses", options.folds, room.responses.size()),
                     "give at most one for each response");
  const std::shared_ptr<const Scene> scene = options.measured.scene(options.measured.acoustics.scene.scene);
  for (const std::string& warning : scene_warnings(*scene)) print_warning(warning);
  options.fit.seed = config.seed;
  FittedRoom fitted;
  {
    std::unique_ptr<Progress> progress;
    fitted = fit_materials(scene, config, room, options.fit, {}, [&](std::size_t done, std::size_t total) {
      if (!progress) progress = std::make_unique<Progress>("fit-materials", "simulations", total);
      progress->update(done);
    });
  }
  const RoomComparison before = compare_room(AcousticScene(scene, config), room),
                       after = compare_room(AcousticScene(with_materials(*scene, fitted), config), room);
  fmt::print("coefficients and standard errors at");
  for (const double hz : fitted.bands_hz) fmt::print(" {:.0f}", hz);
  fmt::print(" Hz\n");
  print(fitted);
  fmt::print("as the scene is:  {}\nfitted:           {}\n", text_of(before), text_of(after));
  nlohmann::ordered_json report{
      {"schema_version", 1}, {"scene", scene->name()}, {"measured", options.measured.measured}, {"seed", config.seed}};
  report.update(fit_json(fitted));
  report["before"] = means_json(before), report["fitted"] = means_json(after);
  write_file_atomically(options.out, material_file(*scene, fitted, options.measured.measured));
  if (options.folds > 1) {
    const RoomComparison held_out = cross_validate(scene, config, room, options);
    fmt::print("held-out places:  {}\n", text_of(held_out));
    report["held_out"] = comparison_json(held_out);
  }
  if (!options.json.empty()) write_file_atomically(options.json, json_text(report, 1) + "\n");
}

}  // namespace

void add_fit_materials(CLI::App& app) {
  auto options = std::make_shared<FitArguments>();
  CLI::App* command = app.add_subcommand(
      "fit-materials", "Find absorption and scattering of a scene's materials with which its responses agree with measured ones");
  options->measured.acoustics.scene.add_to(*command);
  command
      ->add_option("--measured", options->measured.measured,
                   "Folder of sound files with places.yaml, a SOFA file (SingleRoomSRIR), or a folder of them")
      ->type_name(kWholeFolder)
      ->required();
  options->measured.add_to(*command, "balanced");
  command
      ->add_option("--materials", options->fit.materials, "Names of the materials to fit, separated by commas (default: all of the scene)")
      ->delimiter(',');
  command->add_flag("--keep-scattering", options->keep_scattering, "Fit absorption alone");
  command->add_option("--starts", options->fit.starts, "Points of the global search, 2 to 1000")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  command->add_option("--rounds", options->fit.rounds, "Gauss-Newton steps after it, 0 to 100")
      ->check(CLI::Range(0, 100))
      ->capture_default_str();
  command
      ->add_option("--folds", options->folds,
                   "Also predict every place by materials that were fitted to the others, in so many parts; the number of responses leaves "
                   "one out at a time")
      ->check(CLI::Range(2, 1000));
  command->add_option("--out", options->out, "Material file to write (JSON), for the key materials of a scene YAML")
      ->type_name(kOutputFile)
      ->required();
  command->add_option("--json", options->json, "JSON file to write: coefficients, standard errors and mean errors")->type_name(kOutputFile);
  command->callback([options] { run_fit(*options); });
}

}  // namespace earshot
