// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>
#include <optional>

#include "apps/commands.h"
#include "apps/dataset/corpus_command.h"
#include "apps/options/acoustic_options.h"
#include "apps/options/picture_size.h"
#include "apps/options/print_warning.h"
#include "datasets/grid/grid_corpus.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/scene/checks/scene_check.h"

namespace earshot {
namespace {

constexpr double kGridLengthS = 1;

struct DatasetGridArguments {
  AcousticOptions acoustics;
  CorpusTarget target;
  std::string dataset, name, format = "wav", pictures;
  std::optional<double> spacing_m, length_s;
};

/// The options of the responses, with the rate of the data set, the length, and one source field for the listeners of each source where
/// they are not given.
AcousticOptions acoustics_of(const DatasetGridArguments& options, const GridDataset& dataset) {
  AcousticOptions acoustics = options.acoustics;
  acoustics.refuse_settings({"threads"}, "has no effect on a grid", "use the option --threads");
  acoustics.refuse_settings({"temporal_reuse", "glide_paths"}, "has no effect on single responses", "leave it out");
  const double length_s = options.length_s.value_or(kGridLengthS);
  if (options.length_s) acoustics.refuse_settings({"rir_length_s"}, "sets what --length sets", "give either --length or this key");
  require(length_s > 0 && length_s <= 60, "--length", length_s, "must be in (0, 60]");
  // Ahead of the user's, which replace them.  `high` traces paths from both ends, which no field replaces; threads share the sources.
  std::vector<std::string> settings{"threads=1", fmt::format("sample_rate_hz={}", dataset.sample_rate_hz),
                                    fmt::format("rir_length_s={}", length_s)};
  if (acoustic_preset(acoustics.preset).source_rays == 0) settings.emplace_back("field=on");
  acoustics.settings.insert(acoustics.settings.begin(), settings.begin(), settings.end());
  return acoustics;
}

/// The head by its file and what is in it.
std::string head_of(const AcousticOptions& acoustics) {
  if (acoustics.layout().kind != ListenerKind::binaural) {
    if (!acoustics.hrtf.empty() || !acoustics.hrtf_orientation_deg.empty())
      throw InputError("--channels " + acoustics.channels, "has no ears: --hrtf has no effect", "leave one of both out");
    return "none";
  }
  std::string text = acoustics.hrtf.empty() ? "sphere" : fmt::format("{} {}", acoustics.hrtf, hex64(hash64(read_file(acoustics.hrtf))));
  for (const double angle_deg : acoustics.hrtf_orientation_deg) text += fmt::format(" {}", angle_deg);
  return text;
}

GridCorpusConfig config_of(const DatasetGridArguments& options) {
  GridCorpusConfig config;
  config.names = GridNames::of(options.acoustics.scene.scene);
  if (!options.dataset.empty()) config.names.dataset = options.dataset;
  if (options.dataset.empty() && !config.names.warning.empty()) print_warning(config.names.warning);
  if (!options.name.empty()) config.names.scene = options.name;
  validate(config.names);
  const GridDataset dataset = GridDataset::named(config.names.dataset);
  config.spacing_m = options.spacing_m.value_or(dataset.spacing_m);
  config.ear_height_m = dataset.ear_height_m;
  config.channels = options.acoustics.channels;
  static_cast<void>(grid_folder(config.channels));
  config.format = options.format == "zarr" ? GridFormat::zarr : GridFormat::wav;
  config.overrides = options.acoustics.scene.overrides();
  if (!options.pictures.empty()) config.pictures_px = parse_picture_size(options.pictures, "128x128", "--pictures");
  return config;
}

void run_dataset_grid(const DatasetGridArguments& options) {
  GridCorpusConfig config = config_of(options);
  const AcousticOptions sound = acoustics_of(options, GridDataset::named(config.names.dataset));
  config.head = head_of(sound);
  const AcousticScene acoustics = sound.load(sound.config());
  const Scene& scene = acoustics.scene();
  const GridPoints points = find_grid_points(scene, Navmesh(scene.mesh(), NavmeshConfig()), config.spacing_m, config.ear_height_m);
  GridRendering rendering{.acoustics = acoustics, .points = points, .tables = sound.tables(acoustics), .orientations = {}};
  if (sound.layout().kind == ListenerKind::binaural)
    for (const int azimuth_deg : kGridAzimuths) rendering.orientations.push_back(sound.orientation(heading_of_azimuth(azimuth_deg), 0, 0));
  else
    rendering.orientations.emplace_back();
  for (const std::string& warning : scene_warnings(scene)) print_warning(warning);

  GridReport report;
  const double seconds = write_with_progress(options.target, "dataset grid", "responses",
                                             [&](const CorpusRun& run) { report = write_grid_corpus(config, rendering, run); });
  fmt::print("{}: {} points on {:.1f} m2, {} edges; {} unconnected points are left out\n", options.target.out, points.ears.size(),
             points.walkable_m2, points.edges, points.left_out);
  fmt::print("{}: {} responses in {:.1f} s, {:.1f} per second\n", options.target.out, report.responses, seconds,
             static_cast<double>(report.responses) / seconds);
  print_state(options.target, report.folders_missing,
              fmt::format("{} responses in {}/{}/{}", report.all_responses, grid_folder(config.channels), config.names.dataset,
                          config.names.scene));
}

}  // namespace

void add_dataset_grid(CLI::App& dataset) {
  auto options = std::make_shared<DatasetGridArguments>();
  CLI::App* command = dataset.add_subcommand("grid",
                                             "Write the responses between all points of a grid on the floor, in the folders that code for "
                                             "SoundSpaces 1 reads (docs/howto/datasets_grid.md)");
  options->acoustics.add_to(*command, "fast");
  command->get_option("--channels")
      ->description(
          "Listener: binaural (four azimuths in binaural_rirs) or ambisonic:ORDER[:sn3d] (ambisonic_rirs; the published form is "
          "ambisonic:2)");
  command->get_option("--rate")->description("Sample rate in Hz, 8000 to 96000 (default: 44100 for the data set replica, otherwise 16000)");
  add_out_option(*command, options->target);
  command->add_option("--dataset", options->dataset,
                      "DATASET in the paths: mp3d, replica or another name (default: from scene_datasets/DATASET/SCENE in the path of the "
                      "scene, otherwise mp3d). Ears are 1.5528907 m above the floor for replica, otherwise 1.5 m");
  command->add_option("--name", options->name, "SCENE in the paths (default: from the path of the scene)");
  command->add_option("--spacing", options->spacing_m,
                      "Distance between neighbouring points in metres, 0.1 to 100 (default: 0.5 for the data set replica, otherwise 1)");
  command->add_option("--length", options->length_s, fmt::format("Length of the responses in seconds (default: {})", kGridLengthS));
  command
      ->add_option("--format", options->format,
                   "wav: one 32-bit float file per response; zarr: one array per scene (Zarr format 2, no compression)")
      ->check(CLI::IsMember({"wav", "zarr"}))
      ->capture_default_str();
  command->add_option("--pictures", options->pictures,
                      "Pictures of colour and depth at each point for the headings 0, 90, 180 and 270 degrees, WIDTHxHEIGHT in pixels");
  add_sharing_options(*command, options->target, "split by sources");
  command->callback([options] { run_dataset_grid(*options); });
}

}  // namespace earshot
