// SPDX-License-Identifier: Apache-2.0
#include "datasets/corpus_parts.h"

#include <charconv>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <utility>

#include "datasets/corpus_threads.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

int parse_shard_number(const std::string& text, const std::string& digits) {
  int value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc() || end != digits.data() + digits.size())
    throw InputError("--shard " + text, "is not K/N", "write for example 1/4 for the first of four parts");
  return value;
}

/// Parts of the folders of a shard that are not there.
std::vector<std::size_t> missing_parts(const CorpusFolder& folder, const CorpusShard& shard) {
  std::vector<std::size_t> missing;
  for (std::size_t number = 0; number < folder.count(); ++number)
    if (shard.has(number)) {
      const std::vector<std::size_t> left = folder.missing_rooms(number);
      missing.insert(missing.end(), left.begin(), left.end());
    }
  return missing;
}

/// Ends a thread; the error of the thread that failed before it is the one that is thrown.
struct AnotherThreadFailed {};

/// Hands pieces to threads: parts in their order, and when none is left, pieces of parts that others work on.
class CorpusScheduler {
 public:
  CorpusScheduler(const CorpusFolder& folder, const CorpusParts& parts, std::vector<std::size_t> missing)
      : folder_(folder), parts_(parts), missing_(std::move(missing)) {}

  /// Returns the number of recordings that were made.
  std::uint64_t run(const CorpusRun& run) {
    std::uint64_t total = 0;
    for (const std::size_t part : missing_) total += parts_.items(part);
    threads_.run(run.threads, missing_.size() * static_cast<std::size_t>(parts_.pieces), total, run.progress, [this] { work(); });
    return threads_.items();
  }

 private:
  /// A part that threads work on.
  struct PartInWork {
    std::size_t part = 0;
    bool is_ready = false;  ///< begun: its pieces may be made
    int next_piece = 0, done_pieces = 0;
    std::vector<std::string> lines;  ///< of each piece
    std::vector<std::string> names;
  };

  void work() {
    const MakeCorpusPiece make = parts_.make_worker();
    const std::function<void()> count_item = [this] {
      threads_.count_item();
      if (threads_.failed()) throw AnotherThreadFailed();
    };
    while (const std::shared_ptr<PartInWork> part = take_part())
      for (int piece = take_piece(*part); piece >= 0; piece = take_piece(*part)) {
        CorpusPieceWriter writer(folder_, part->part);
        make({part->part, piece}, writer, count_item);
        finish_piece(*part, piece, writer);
      }
  }

  /// The next part, begun, or else one that has pieces left; null when there is nothing left to do.
  std::shared_ptr<PartInWork> take_part() {
    std::unique_lock lock(mutex_);
    if (!threads_.failed() && next_part_ < missing_.size()) {
      auto part = std::make_shared<PartInWork>();
      part->part = missing_[next_part_++];
      part->lines.resize(static_cast<std::size_t>(parts_.pieces));
      in_work_.push_back(part);
      lock.unlock();
      if (parts_.begin) parts_.begin(part->part);
      lock.lock();
      part->is_ready = true;
      changed_.notify_all();
      return part;
    }
    for (;;) {
      if (threads_.failed()) return nullptr;
      bool begins = false;
      for (const std::shared_ptr<PartInWork>& part : in_work_) {
        if (part->is_ready && part->next_piece < parts_.pieces) return part;
        begins = begins || !part->is_ready;
      }
      if (!begins) return nullptr;
      changed_.wait_for(lock, std::chrono::milliseconds(200));
    }
  }

  int take_piece(PartInWork& part) {
    const std::lock_guard lock(mutex_);
    return !threads_.failed() && part.next_piece < parts_.pieces ? part.next_piece++ : -1;
  }

  void finish_piece(PartInWork& part, int piece, const CorpusPieceWriter& writer) {
    {
      const std::lock_guard lock(mutex_);
      part.lines[static_cast<std::size_t>(piece)] = writer.lines();
      part.names.insert(part.names.end(), writer.names().begin(), writer.names().end());
      if (++part.done_pieces < parts_.pieces) return;
      std::erase_if(in_work_, [&](const auto& other) { return other.get() == &part; });
    }
    if (parts_.end) parts_.end(part.part);
    std::string text;
    for (const std::string& lines : part.lines) text += lines;
    folder_.finish_room(part.part, part.names, text);
  }

  const CorpusFolder& folder_;
  const CorpusParts& parts_;
  const std::vector<std::size_t> missing_;

  CorpusThreads threads_;
  std::mutex mutex_;  ///< guards what follows, and PartInWork but for what one thread writes
  std::condition_variable changed_;
  std::size_t next_part_ = 0;
  std::vector<std::shared_ptr<PartInWork>> in_work_;
};

}  // namespace

CorpusShard CorpusShard::parse(const std::string& text) {
  const std::size_t slash = text.find('/');
  CorpusShard shard{parse_shard_number(text, text.substr(0, slash)),
                    slash == std::string::npos ? 0 : parse_shard_number(text, text.substr(slash + 1))};
  if (shard.count < 1 || shard.count > 1'000'000 || shard.index < 1 || shard.index > shard.count)
    throw InputError("--shard " + text, "is not K/N with K from 1 to N", "write for example 1/4 for the first of four parts");
  return shard;
}

std::string CorpusPieceWriter::write(const std::string& name, std::string_view bytes) {
  folder_.write_sound(part_, name, bytes);
  names_.push_back(name);
  return folder_.prefix_of(part_) + name;
}

void validate(const CorpusRun& run) {
  require(run.threads >= 0 && run.threads <= 1024, "--threads", run.threads, "must be in [0, 1024]; 0: all cores");
}

CorpusPartsReport complete_corpus(const CorpusFolder& folder, const CorpusRun& run, const CorpusParts& parts) {
  std::vector<std::size_t> missing = missing_parts(folder, run.shard);
  CorpusPartsReport report;
  report.parts = missing.size();
  if (!missing.empty()) report.items = CorpusScheduler(folder, parts, std::move(missing)).run(run);
  report.folders_missing = folder.join_manifests(parts.derived);
  return report;
}

}  // namespace earshot
