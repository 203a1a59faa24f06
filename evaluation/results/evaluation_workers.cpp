// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/evaluation_workers.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <optional>
#include <string_view>
#include <thread>

#include "evaluation/results/evaluation_parts.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/progress.h"
#include "sim/base/temporary_folder.h"
#include "trainer/launch/worker_group.h"

namespace earshot {
namespace {

// In the folder: a 64-bit number per worker; the checkpoint, and the path that it was read from.
constexpr const char *kCounts = "episodes_done", *kCheckpoint = "checkpoint", *kCheckpointPath = "checkpoint_path";

std::filesystem::path part_file(const std::filesystem::path& folder, int part) { return folder / fmt::format("part_{}.json", part); }

int number_of(const char* variable) {
  const char* text = std::getenv(variable);
  int value = -1;
  if (text != nullptr) std::from_chars(text, text + std::strlen(text), value);
  return value;
}

}  // namespace

struct EvaluationWorker::Impl {
  std::filesystem::path folder;
  std::string name;
  int part = 0, parts = 1, counts = -1;
  std::optional<Progress> progress;
  std::size_t num_episodes = 0;

  void note(std::uint64_t done) const {
    if (::pwrite(counts, &done, sizeof(done), static_cast<off_t>(part) * static_cast<off_t>(sizeof(done))) != sizeof(done))
      throw RunError((folder / kCounts).string(), fmt::format("cannot be written: {}", std::strerror(errno)));
  }
  /// Of all workers; those that have not written yet count as zero.
  [[nodiscard]] std::uint64_t done_by_all() const {
    std::uint64_t sum = 0;
    for (int i = 0; i < parts; ++i) {
      std::uint64_t done = 0;
      if (::pread(counts, &done, sizeof(done), static_cast<off_t>(i) * static_cast<off_t>(sizeof(done))) == sizeof(done)) sum += done;
    }
    return sum;
  }
};

EvaluationWorker::EvaluationWorker(std::filesystem::path folder, std::string name) : impl_(std::make_unique<Impl>()) {
  Impl& in = *impl_;
  in.folder = std::move(folder);
  in.name = std::move(name);
  in.part = number_of("EARSHOT_RANK");
  in.parts = number_of("EARSHOT_WORLD_SIZE");
  in.counts = ::open((in.folder / kCounts).c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (in.part < 0 || in.parts <= in.part || in.counts < 0)
    throw InputError(kPartFolderOption, "is internal to the processes of 'earshot eval --workers'", "leave it out");
}

EvaluationWorker::~EvaluationWorker() {
  if (impl_->counts >= 0) ::close(impl_->counts);
}

CheckpointBytes EvaluationWorker::checkpoint() const {
  return {read_file(impl_->folder / kCheckpointPath), read_file(impl_->folder / kCheckpoint)};
}

void EvaluationWorker::prepare(EvaluationConfig& evaluation, std::size_t num_episodes) {
  Impl& in = *impl_;
  in.num_episodes = num_episodes;
  if (evaluation.threads == 0) evaluation.threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()) / in.parts);
  if (in.part == 0) in.progress.emplace("evaluate " + in.name, "episode", num_episodes);
  evaluation.part = EvaluationPart{.part = in.part, .parts = in.parts, .on_progress = [&in](std::size_t done) {
                                     in.note(done);
                                     if (in.progress) in.progress->update(in.done_by_all());
                                   }};
}

void EvaluationWorker::finish(const EvaluationResult& result) {
  Impl& in = *impl_;
  save_result(result, part_file(in.folder, in.part));
  // The progress is that of all.  A worker that fails ends this one.
  while (in.progress && in.done_by_all() < in.num_episodes) {
    in.progress->update(in.done_by_all());
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  if (in.progress) in.progress->update(in.num_episodes);
}

EvaluationResult evaluate_with_workers(int workers, std::vector<std::string> arguments, const CheckpointBytes* checkpoint, int& exit_code) {
  const TemporaryFolder folder(temporary_parent(), "earshot-eval-");
  if (checkpoint != nullptr) {
    write_file_atomically(folder.path() / kCheckpoint, checkpoint->bytes);
    write_file_atomically(folder.path() / kCheckpointPath, checkpoint->path.string());
  }
  arguments.emplace_back(kPartFolderOption);
  arguments.push_back(folder.path().string());
  exit_code = spawn_workers(workers, arguments);
  if (exit_code != 0) return {};
  std::vector<std::filesystem::path> files;
  for (int part = 0; part < workers; ++part) files.push_back(part_file(folder.path(), part));
  return join_evaluation_parts(files, "eval --workers");
}

}  // namespace earshot
