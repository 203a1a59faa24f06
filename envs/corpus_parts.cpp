#include "envs/corpus_parts.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>

#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// Hands parts to threads in their order.
class PartWork {
 public:
  PartWork(const CorpusFolder& folder, const CorpusParts& parts, const std::vector<std::size_t>& missing)
      : folder_(folder), parts_(parts), missing_(missing) {}

  void run(int threads, const std::function<void(std::uint64_t, std::uint64_t)>& progress) {
    std::uint64_t total = 0;
    for (const std::size_t part : missing_) total += parts_.items(part);
    std::vector<std::thread> workers;
    for (int i = 0; i < threads; ++i) workers.emplace_back([this] { work(); });
    for (bool ended = false; !ended;) {
      std::uint64_t done = 0;
      {
        std::unique_lock lock(mutex_);
        ended = changed_.wait_for(lock, std::chrono::milliseconds(200), [&] { return ended_workers_ == threads; });
        done = done_;
      }
      if (progress) progress(done, total);
    }
    for (std::thread& worker : workers) worker.join();
    if (error_) std::rethrow_exception(error_);
  }
  [[nodiscard]] std::uint64_t done() const { return done_; }

 private:
  void work() {
    flush_denormals_on_this_thread();
    try {
      MakeCorpusPart make;
      for (std::size_t part = 0; take(part);) {
        if (!make) make = parts_.make_worker();
        CorpusPartWriter writer(folder_, part);
        make(part, writer, [this] {
          const std::lock_guard lock(mutex_);
          ++done_;
        });
        writer.finish();
      }
    } catch (...) {
      const std::lock_guard lock(mutex_);
      if (!error_) error_ = std::current_exception();
    }
    const std::lock_guard lock(mutex_);
    ++ended_workers_;
    changed_.notify_all();
  }
  bool take(std::size_t& part) {
    const std::lock_guard lock(mutex_);
    if (error_ || next_ == missing_.size()) return false;
    part = missing_[next_++];
    return true;
  }

  const CorpusFolder& folder_;
  const CorpusParts& parts_;
  const std::vector<std::size_t>& missing_;

  std::mutex mutex_;  ///< guards what follows
  std::condition_variable changed_;
  std::size_t next_ = 0;
  std::uint64_t done_ = 0;
  int ended_workers_ = 0;
  std::exception_ptr error_;
};

}  // namespace

std::string CorpusPartWriter::write(const std::string& name, std::string_view bytes) {
  folder_.write_sound(part_, name, bytes);
  names_.push_back(name);
  return folder_.prefix_of(part_) + name;
}

CorpusPartsReport complete_corpus(const CorpusFolder& folder, const CorpusRun& run, const CorpusParts& parts) {
  require(run.threads >= 0 && run.threads <= 1024, "--threads", run.threads, "must be in [0, 1024]; 0 means all cores");
  const std::vector<std::size_t> missing = missing_parts(folder, run.shard);
  CorpusPartsReport report;
  if (!missing.empty()) {
    PartWork work(folder, parts, missing);
    const int cores = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
    const int threads = run.threads > 0 ? run.threads : cores;
    work.run(static_cast<int>(std::min(missing.size(), static_cast<std::size_t>(threads))), run.progress);
    report.items = work.done();
  }
  report.folders_missing = folder.join_manifests(parts.derived);
  return report;
}

std::vector<std::size_t> missing_parts(const CorpusFolder& folder, const CorpusShard& shard) {
  std::vector<std::size_t> missing;
  for (std::size_t number = 0; number < folder.count(); ++number)
    if (number % static_cast<std::size_t>(shard.count) == static_cast<std::size_t>(shard.index - 1)) {
      const std::vector<std::size_t> left = folder.missing_rooms(number);
      missing.insert(missing.end(), left.begin(), left.end());
    }
  return missing;
}

}  // namespace earshot
