#include "datasets/rir_corpus.h"

#include <fmt/format.h>

#include <charconv>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>
#include <vector>

#include "datasets/corpus_parts.h"
#include "datasets/corpus_threads.h"
#include "datasets/rir_corpus_folder.h"
#include "datasets/rir_corpus_response.h"
#include "datasets/rir_corpus_room.h"
#include "sim/base/engine_commit.h"
#include "sim/base/errors.h"
#include "sim/scene/appearance.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

/// A room that threads work on: its sources one by one, each by one thread.
struct RoomInWork {
  std::size_t index = 0;
  std::shared_ptr<const CorpusRoom> room;  ///< null while it is loaded
  int next_source = 0, done_sources = 0;
  std::vector<std::vector<std::string>> lines;  ///< [source][listener]
  std::vector<std::string> files;
};

/// Hands rooms to threads in their order; when none is left, sources of rooms that others work on.
class CorpusWork {
 public:
  CorpusWork(const RirCorpusConfig& config, CorpusFolder& folder, const std::vector<CorpusRoomSpec>& rooms,
             std::vector<std::size_t> missing, const CorpusRun& run)
      : config_(config),
        folder_(folder),
        rooms_(rooms),
        missing_(std::move(missing)),
        tables_(corpus_tables(config)),
        encode_sofa_(run.encode_sofa) {}

  void run(int threads, const std::function<void(std::uint64_t, std::uint64_t)>& progress) {
    const std::uint64_t total = missing_.size() * responses_per_room();
    threads_.run(threads, missing_.size() * static_cast<std::size_t>(config_.sources_per_room), total, progress, [this] { work(); });
  }
  [[nodiscard]] std::uint64_t done_responses() const { return threads_.items(); }
  [[nodiscard]] std::uint64_t responses_per_room() const {
    return static_cast<std::uint64_t>(config_.sources_per_room) * static_cast<std::uint64_t>(config_.listeners_per_source);
  }

 private:
  void work() {
    std::vector<RirSynthesizer> heads;
    for (const auto& tables : tables_) heads.emplace_back(tables);
    while (const std::shared_ptr<RoomInWork> room = take_room()) {
      for (;;) {
        const int source = take_source(*room);
        if (source < 0) break;
        render(*room, source, heads);
      }
    }
  }

  /// The next room, loaded, or else one that has sources left; null when there is nothing left to do.
  std::shared_ptr<RoomInWork> take_room() {
    std::unique_lock lock(mutex_);
    if (!threads_.failed() && next_room_ < missing_.size()) {
      auto room = std::make_shared<RoomInWork>();
      room->index = missing_[next_room_++];
      room->lines.resize(static_cast<std::size_t>(config_.sources_per_room));
      in_work_.push_back(room);
      lock.unlock();
      auto loaded = std::make_shared<const CorpusRoom>(config_, room->index, rooms_[room->index]);
      lock.lock();
      room->room = std::move(loaded);
      changed_.notify_all();
      return room;
    }
    for (;;) {
      if (threads_.failed()) return nullptr;
      bool loading = false;
      for (const std::shared_ptr<RoomInWork>& room : in_work_) {
        if (room->room && room->next_source < config_.sources_per_room) return room;
        loading = loading || !room->room;
      }
      if (!loading) return nullptr;
      changed_.wait_for(lock, std::chrono::milliseconds(200));
    }
  }
  int take_source(RoomInWork& room) {
    const std::lock_guard lock(mutex_);
    return !threads_.failed() && room.next_source < config_.sources_per_room ? room.next_source++ : -1;
  }

  void render(RoomInWork& room, int source, std::span<RirSynthesizer> heads) {
    CorpusSourceRenderer renderer(config_, *room.room, room.index, source, heads);
    std::vector<std::string> lines, names;
    std::vector<CorpusFile> files;
    for (int listener = 0; listener < config_.listeners_per_source; ++listener) {
      files.clear();
      lines.push_back(renderer.render(listener, folder_.prefix_of(room.index), files));
      for (const CorpusFile& file : files) {
        folder_.write_sound(room.index, file.name, file.bytes);
        names.push_back(file.name);
      }
      threads_.count_item();
      if (threads_.failed()) return;
    }
    if (config_.sofa) {
      names.push_back(renderer.sofa_name());
      folder_.write_sound(room.index, names.back(), encode_sofa_(renderer.sofa(), names.back()));
    }
    std::unique_lock lock(mutex_);
    room.lines[static_cast<std::size_t>(source)] = std::move(lines);
    room.files.insert(room.files.end(), names.begin(), names.end());
    if (++room.done_sources < config_.sources_per_room) return;
    std::erase_if(in_work_, [&](const auto& other) { return other.get() == &room; });
    lock.unlock();
    std::string text;
    for (const auto& of_source : room.lines)
      for (const std::string& line : of_source) text += line + "\n";
    folder_.finish_room(room.index, room.files, text);
  }

  const RirCorpusConfig& config_;
  CorpusFolder& folder_;
  const std::vector<CorpusRoomSpec>& rooms_;
  const std::vector<std::size_t> missing_;
  std::vector<std::shared_ptr<const SynthesisTables>> tables_;
  std::function<std::string(const SofaRoomResponses&, const std::string&)> encode_sofa_;

  CorpusThreads threads_;
  std::mutex mutex_;  ///< guards what follows, and RoomInWork but for what one thread writes
  std::condition_variable changed_;
  std::size_t next_room_ = 0;
  std::vector<std::shared_ptr<RoomInWork>> in_work_;
};

std::string description_of(const RirCorpusConfig& config, std::size_t rooms) {
  const ListenerLayout layout = ListenerLayout::named(config.channels);
  const float rate_hz = config.acoustics.sample_rate_hz;
  const BandLayout bands =
      config.acoustics.bands == 0 ? BandLayout::octaves(rate_hz) : BandLayout::log_spaced(config.acoustics.bands, rate_hz);
  const auto per_room = static_cast<std::size_t>(config.sources_per_room) * static_cast<std::size_t>(config.listeners_per_source);
  Json centres = Json::array();
  for (const float hz : bands.centre_hz) centres.push_back(std::round(10 * static_cast<double>(hz)) / 10);
  Json json = {{"earshot_corpus", 1},
               {"engine", engine_commit() + " " + build_type()},
               {"rooms", rooms},
               {"responses", rooms * per_room},
               {"channels", channel_names(layout)},
               {"sample_rate_hz", rate_hz},
               {"bands_hz", centres},
               {"config", config_text(config)}};
  if (config.panorama) json["categories"] = category_names();
  return json.dump(1) + "\n";
}

int parse_part(const std::string& text, const std::string& digits) {
  int value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc() || end != digits.data() + digits.size())
    throw InputError("--shard " + text, "is not K/N", "write for example 1/4 for the first of four parts");
  return value;
}

}  // namespace

CorpusShard CorpusShard::parse(const std::string& text) {
  const std::size_t slash = text.find('/');
  CorpusShard shard{parse_part(text, text.substr(0, slash)), slash == std::string::npos ? 0 : parse_part(text, text.substr(slash + 1))};
  if (shard.count < 1 || shard.count > 1'000'000 || shard.index < 1 || shard.index > shard.count)
    throw InputError("--shard " + text, "is not K/N with K from 1 to N", "write for example 1/4 for the first of four parts");
  return shard;
}

CorpusReport write_rir_corpus(const RirCorpusConfig& config, const CorpusRun& run) {
  validate(config);
  require(run.threads >= 0 && run.threads <= 1024, "--threads", run.threads, "must be in [0, 1024]; 0 means all cores");
  if (config.sofa && !run.encode_sofa)
    throw InputError("sofa", "cannot be written: this program was built without HDF5",
                     "install libhdf5-dev and build again, or leave it out");
  const std::vector<CorpusRoomSpec> rooms = list_corpus_rooms(config);
  CorpusFolder folder(run.out, rooms.size(), static_cast<std::size_t>(config.rooms_per_folder), config.acoustics.sample_rate_hz,
                      config.sofa ? 0 : channel_names(ListenerLayout::named(config.channels)).size());
  folder.begin(description_of(config, rooms.size()));

  std::vector<std::size_t> missing = missing_parts(folder, run.shard);
  CorpusReport report;
  report.rooms = missing.size();
  report.all_responses =
      rooms.size() * static_cast<std::size_t>(config.sources_per_room) * static_cast<std::size_t>(config.listeners_per_source);
  if (!missing.empty()) {
    CorpusWork work(config, folder, rooms, std::move(missing), run);
    work.run(run.threads, run.progress);
    report.responses = work.done_responses();
  }
  report.folders_missing = folder.join_manifests();
  return report;
}

}  // namespace earshot
