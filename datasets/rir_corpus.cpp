// SPDX-License-Identifier: Apache-2.0
#include "datasets/rir_corpus.h"

#include <cmath>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <span>
#include <vector>

#include "datasets/corpus_folder.h"
#include "datasets/corpus_parts.h"
#include "datasets/inputs/wished_rooms.h"
#include "datasets/rir_corpus_response.h"
#include "datasets/rir_corpus_room.h"
#include "sim/base/engine_commit.h"
#include "sim/base/errors.h"
#include "sim/base/text/json.h"
#include "sim/scene/appearance.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

/// Renderer of one thread.
class CorpusRoomWorker {
 public:
  CorpusRoomWorker(const RirCorpusConfig& config, const CorpusRun& run, std::span<const std::shared_ptr<const SynthesisTables>> tables)
      : config_(config), run_(run) {
    for (const auto& of_head : tables) heads_.emplace_back(of_head);
  }

  /// All listeners of a source.
  void render(const CorpusRoom& room, CorpusPiece source, const std::string& prefix, CorpusPieceWriter& writer,
              const std::function<void()>& count_item) {
    CorpusSourceRenderer renderer(config_, room, source.part, source.number, heads_);
    std::vector<CorpusFile> files;
    for (int listener = 0; listener < config_.listeners_per_source; ++listener) {
      files.clear();
      writer.add_line(renderer.render(listener, prefix, files));
      for (const CorpusFile& file : files) writer.write(file.name, file.bytes);
      count_item();
    }
    if (config_.sofa) writer.write(renderer.sofa_name(), run_.encode_sofa(renderer.sofa(), renderer.sofa_name()));
  }

 private:
  const RirCorpusConfig& config_;
  const CorpusRun& run_;
  std::vector<RirSynthesizer> heads_;
};

std::string description_of(const RirCorpusConfig& config, std::size_t rooms) {
  const ListenerLayout layout = ListenerLayout::named(config.channels);
  const float rate_hz = config.acoustics.sample_rate_hz;
  const BandLayout bands = bands_of(config.acoustics);
  const auto per_room = static_cast<std::size_t>(config.sources_per_room) * static_cast<std::size_t>(config.listeners_per_source);
  Json centres = Json::array();
  for (const float hz : bands.centre_hz) centres.push_back(std::round(10 * static_cast<double>(hz)) / 10);
  Json json = {{"earshot_corpus", 1},
               {"engine", engine_commit() + " " + build_type()},
               {"rooms", rooms},
               {"responses", rooms * per_room},
               {"channels", layout.channel_names()},
               {"sample_rate_hz", rate_hz},
               {"bands_hz", centres},
               {"config", config_text(config)}};
  if (config.panorama) json["categories"] = category_names();
  return json_text(json, 1) + "\n";
}

}  // namespace

CorpusReport write_rir_corpus(const RirCorpusConfig& config, const CorpusRun& run) {
  validate(config);
  validate(run);
  if (config.sofa && !run.encode_sofa)
    throw InputError("sofa", "cannot be written: this build has no HDF5", "install libhdf5-dev and build again, or leave out sofa");
  const std::vector<CorpusRoomSpec> rooms = list_corpus_rooms(config);
  const CorpusFolder folder(run.out, rooms.size(), static_cast<std::size_t>(config.rooms_per_folder), config.acoustics.sample_rate_hz,
                            config.sofa ? 0 : static_cast<std::size_t>(ListenerLayout::named(config.channels).num_channels()));
  folder.begin(description_of(config, rooms.size()));

  const std::uint64_t per_room =
      static_cast<std::uint64_t>(config.sources_per_room) * static_cast<std::uint64_t>(config.listeners_per_source);
  std::once_flag tables_once;  // a corpus that is complete reads no heads
  std::vector<std::shared_ptr<const SynthesisTables>> tables;
  std::vector<std::shared_ptr<const CorpusRoom>> loaded(rooms.size());  // those that threads work on
  const CorpusPartsReport done =
      complete_corpus(folder, run,
                      {.pieces = config.sources_per_room,
                       .items = [&](std::size_t) { return per_room; },
                       .begin = [&](std::size_t room) { loaded[room] = load_wished_room(config, room, rooms[room]); },
                       .end = [&](std::size_t room) { loaded[room].reset(); },
                       .make_worker =
                           [&] {
                             std::call_once(tables_once, [&] { tables = corpus_tables(config); });
                             auto worker = std::make_shared<CorpusRoomWorker>(config, run, tables);
                             return [&, worker](CorpusPiece source, CorpusPieceWriter& writer, const std::function<void()>& count_item) {
                               worker->render(*loaded[source.part], source, folder.prefix_of(source.part), writer, count_item);
                             };
                           }});
  return {.rooms = done.parts, .responses = done.items, .all_responses = rooms.size() * per_room, .folders_missing = done.folders_missing};
}

}  // namespace earshot
