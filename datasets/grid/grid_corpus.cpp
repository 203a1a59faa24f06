// SPDX-License-Identifier: Apache-2.0
#include "datasets/grid/grid_corpus.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>
#include <vector>

#include "datasets/corpus_folder.h"
#include "datasets/grid/grid_files.h"
#include "datasets/grid/grid_pictures.h"
#include "sim/acoustics/synthesis/synthesis_tables.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

/// Renderer of one thread.
class GridWorker {
 public:
  GridWorker(const GridRendering& rendering, const GridFiles& files, const GridPictures* pictures, std::string pictures_folder)
      : rendering_(rendering),
        files_(files),
        pictures_(pictures),
        pictures_folder_(std::move(pictures_folder)),
        synthesizer_(rendering.tables) {}

  /// All responses of a source, and what is seen from there.
  void render(std::size_t source, CorpusPieceWriter& writer, const std::function<void()>& count_item) {
    GridSource renderer(rendering_, synthesizer_, source);
    const std::unique_ptr<GridSourceFiles> files = files_.of_source(source);
    for (std::size_t receiver = 0; receiver < rendering_.points.ears.size(); ++receiver) {
      nlohmann::ordered_json line = renderer.render(receiver, [&](std::size_t orientation, const Rir& rir) {
        files->add(receiver, orientation, rir, writer);
        count_item();
      });
      files->label(receiver, line);
      writer.add_line(json_text(line));
    }
    if (!pictures_) return;
    for (const CorpusFile& file : pictures_->render(rendering_.points.feet[source], fmt::format("{}/{}", pictures_folder_, source)))
      writer.write(file.name, file.bytes);
  }

 private:
  const GridRendering& rendering_;
  const GridFiles& files_;
  const GridPictures* pictures_;
  std::string pictures_folder_;
  RirSynthesizer synthesizer_;
};

std::string description_of(const GridCorpusConfig& config, const GridRendering& rendering) {
  ConfigReader recorder = ConfigReader::recorder();
  AcousticConfig acoustics = rendering.acoustics.config();
  read(recorder, acoustics);
  const Scene& scene = rendering.acoustics.scene();
  const std::string text = fmt::format(
      "scene: {}\nscene_hash: {}\ndataset: {}\nname: {}\nspacing_m: {}\near_height_m: {}\npoints: {}\npoints_hash: {}\nchannels: {}\n"
      "head: {}\nformat: {}\npictures: {}\n{}",
      scene.name(), hex64(scene.hash()), config.names.dataset, config.names.scene, config.spacing_m, config.ear_height_m,
      rendering.points.ears.size(), hex64(hash64(rendering.points.points_text + rendering.points.edges_text)), config.channels, config.head,
      config.format == GridFormat::wav ? "wav" : "zarr",
      config.pictures_px ? fmt::format("{}x{}", config.pictures_px->first, config.pictures_px->second) : "none", recorder.effective());
  return CorpusFolder::describe("grid", text, acoustics.sample_rate_hz, ListenerLayout::named(config.channels).channel_names());
}

/// What the responses to two ears and the harmonics of a scene have in common: points, and pictures if both have them.
class SharedFiles {
 public:
  SharedFiles(const GridCorpusConfig& config, const GridRendering& rendering, const std::filesystem::path& out) {
    const Scene& scene = rendering.acoustics.scene();
    const std::filesystem::path names = std::filesystem::path(config.names.dataset) / config.names.scene,
                                metadata = out / "metadata" / names;
    const char *points = "lists other points than this run", *use = "use the same scene and --spacing, another --name, or another folder";
    nlohmann::ordered_json of_scene{{"scene_hash", hex64(scene.hash())},
                                    {"dataset", config.names.dataset},
                                    {"spacing_m", config.spacing_m},
                                    {"ear_height_m", config.ear_height_m}};
    // scene.json last to be compared, first to be written: points without it are of no known scene.
    files_.push_back({metadata / "points.txt", rendering.points.points_text, points, use});
    files_.push_back({metadata / "edges.txt", rendering.points.edges_text, points, use});
    files_.push_back({metadata / "scene.json", json_text(of_scene, 1) + "\n", "is of another scene, with other materials or air",
                      "use the same scene, another --name, or another folder"});
    metadata_ = metadata;
    if (!config.pictures_px) return;
    const auto& [width_px, height_px] = *config.pictures_px;
    const nlohmann::ordered_json of_pictures{
        {"scene", scene.name()}, {"scene_hash", hex64(scene.hash())}, {"width_px", width_px}, {"height_px", height_px}};
    files_.push_back({out / "scene_observations" / names / "pictures.json", json_text(of_pictures, 1) + "\n",
                      "is of pictures of another size or another scene",
                      "use the same scene and --pictures, leave --pictures out, or use another --name or folder"});
  }
  void check() const {
    for (const File& file : files_)
      if (std::filesystem::exists(file.path) && read_file(file.path) != file.text)
        throw InputError(file.path.string(), file.problem, file.advice);
    if (std::filesystem::exists(metadata_ / "points.txt") && !std::filesystem::exists(metadata_ / "scene.json"))
      throw InputError(metadata_.string(), "has points, but no scene.json that says of which scene",
                       "use another --name or another folder");
  }
  void write() const {
    for (auto file = files_.rbegin(); file != files_.rend(); ++file)
      if (!std::filesystem::exists(file->path)) write_file_atomically(file->path, file->text);
  }

 private:
  struct File {
    std::filesystem::path path;
    std::string text;
    const char *problem, *advice;
  };
  std::vector<File> files_;
  std::filesystem::path metadata_;
};

void remove_file(const std::filesystem::path& file) {
  std::error_code error;
  std::filesystem::remove(file, error);
  if (error) throw RunError(file.string(), "cannot be removed: " + error.message());
}

/// Refuses to begin what does not fit: the sizes of all files are known.
void check_space(const std::filesystem::path& out, std::uint64_t bytes) {
  std::filesystem::path existing = std::filesystem::absolute(out);
  while (!std::filesystem::exists(existing) && existing.has_relative_path()) existing = existing.parent_path();
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(existing, error);
  if (error || space.capacity == 0 || bytes <= space.available) return;
  constexpr double gb = 1e9;
  throw InputError(
      out.string(),
      fmt::format("needs {:.2f} GB, but {:.2f} GB are free", static_cast<double>(bytes) / gb, static_cast<double>(space.available) / gb),
      "free some space, use another disk, a larger --spacing or a shorter --length, or write one --shard");
}

}  // namespace

std::string grid_folder(const std::string& channels) {
  const ListenerLayout layout = ListenerLayout::named(channels);
  if (layout.kind == ListenerKind::binaural) return "binaural_rirs";
  if (layout.kind == ListenerKind::ambisonics && layout.axes == HarmonicAxes::world) return "ambisonic_rirs";
  throw InputError("--channels " + channels, "has no folder in this form", "use binaural or ambisonic:ORDER");
}

GridReport write_grid_corpus(const GridCorpusConfig& config, const GridRendering& rendering, const CorpusRun& run) {
  validate(run);
  validate(config.names);
  const std::size_t count = rendering.points.ears.size(), per_source = count * rendering.orientations.size();
  const std::string &dataset = config.names.dataset, &scene = config.names.scene;
  const std::string folder_name = fmt::format("{}/{}/{}", grid_folder(config.channels), dataset, scene);
  const AcousticConfig& acoustics = rendering.acoustics.config();
  const GridFiles files({.folder = folder_name,
                         .num_points = count,
                         .num_channels = static_cast<std::size_t>(ListenerLayout::named(config.channels).num_channels()),
                         .num_samples = static_cast<std::size_t>(rendering.tables->num_samples),
                         .has_azimuths = rendering.orientations.size() > 1,
                         .sample_rate_hz = acoustics.sample_rate_hz,
                         .format = config.format});
  std::unique_ptr<const GridPictures> pictures;
  if (config.pictures_px)
    pictures = std::make_unique<const GridPictures>(rendering.acoustics.scene(), config.overrides, config.pictures_px->first,
                                                    config.pictures_px->second);

  const CorpusFolder folder(run.out / folder_name, count, 1, acoustics.sample_rate_hz, 0, run.out);
  const SharedFiles shared(config, rendering, run.out);
  const std::uint64_t source_bytes = files.bytes_of_source() + (pictures ? pictures->bytes() : 0);
  std::uint64_t missing = 0;
  for (std::size_t source = 0; source < count; ++source) missing += run.shard.has(source) && !folder.is_complete(source);
  const std::string description = description_of(config, rendering);
  if (std::filesystem::exists(run.out / folder_name / "corpus.json")) folder.begin(description);  // compares, and writes nothing
  shared.check();
  check_space(run.out, missing * source_bytes);
  folder.begin(description);
  shared.write();
  if (missing > 0)  // an array that is written again is not complete
    for (const CorpusFile& file : files.index()) remove_file(run.out / file.name);

  const CorpusPartsReport done =
      complete_corpus(folder, run,
                      {.items = [&](std::size_t) { return per_source; },
                       .make_worker =
                           [&] {
                             auto worker = std::make_shared<GridWorker>(rendering, files, pictures.get(),
                                                                        fmt::format("scene_observations/{}/{}", dataset, scene));
                             return [worker](CorpusPiece source, CorpusPieceWriter& writer, const std::function<void()>& count_item) {
                               worker->render(source.part, writer, count_item);
                             };
                           }});
  if (done.folders_missing == 0)
    for (const CorpusFile& file : files.index()) write_file_atomically(run.out / file.name, file.bytes);
  return {.responses = done.items, .all_responses = count * per_source, .folders_missing = done.folders_missing};
}

}  // namespace earshot
