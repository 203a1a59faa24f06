// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/run_files.h"

#include <fmt/format.h>

#include <cerrno>
#include <exception>
#include <optional>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/log.h"
#include "trainer/curves/curve_svg.h"
#include "trainer/curves/metrics_file.h"

namespace earshot {
namespace {

template <class Write>
std::uint64_t failures_of(const Write& write) {
  try {
    write();
    return 0;
  } catch (const std::exception& error) {
    log_error(fmt::format("{}; training continues", error.what()));
    return 1;
  }
}

/// Whether room is what a write lacks: on the disk, or in the user's quota.
bool is_full_disk(const RunError& error) {
  const std::string_view message = error.what();
  for (const int code : {ENOSPC, EDQUOT})
    if (message.find(std::generic_category().message(code)) != std::string_view::npos) return true;
  return false;
}

RunFolder without_temporaries(const RunConfig& config) {
  RunFolder folder(config.out);
  folder.remove_temporaries();
  return folder;
}

}  // namespace

RunFiles::RunFiles(const RunConfig& config, std::uint64_t update, DiskPatience patience, Write write, std::uint64_t evaluated_update)
    : config_(config),
      patience_(patience),
      write_(std::move(write)),
      folder_(without_temporaries(config)),
      events_(config.out, update, evaluated_update),
      checkpoints_(folder_, config.keep, update),
      saved_update_(update) {}

std::uint64_t RunFiles::write_point(const CurvePoint& point) {
  std::uint64_t failed = failures_of([&] { events_.write(point); });
  if (config_.metrics_file.empty()) return failed;
  (is_of_held_out(point) ? last_evaluation_ : last_update_) = point;
  // The file holds all there is to know now; behind a resumed run's first evaluation there is no update yet.
  CurvePoint both = last_update_.values.empty() ? CurvePoint{point.update, point.env_steps, point.wall_s, {}} : last_update_;
  both.values.insert(both.values.end(), last_evaluation_.values.begin(), last_evaluation_.values.end());
  failed += failures_of([&] { write_metrics_file(config_.metrics_file, both, config_.name); });
  return failed;
}

std::filesystem::path RunFiles::checkpoint_of(std::uint64_t update, bool is_last) const {
  return is_last ? folder_.last_checkpoint() : folder_.checkpoint_of(update);
}

std::uint64_t RunFiles::write_beside(const std::filesystem::path& file, const Checkpoint& checkpoint, bool is_whole, bool is_last) {
  std::uint64_t failed = is_whole ? 0 : 1;
  if (is_whole) failed += failures_of([&] { checkpoints_.saved(file, checkpoint, is_last); });
  failed += failures_of([&] { write_file_atomically(folder_.curve(), curve_svg(config_.name, read_event_log(folder_.event_log()))); });
  return failed;
}

void RunFiles::write_making_room(const std::filesystem::path& file, const Checkpoint& checkpoint) {
  while (true) try {
      write_(checkpoint, file);
      saved_update_ = checkpoint.update;
      owes_checkpoint_ = false;
      return;
    } catch (const RunError& error) {
      const auto dropped = is_full_disk(error) ? folder_.drop_oldest() : std::nullopt;
      if (!dropped) throw;
      log_warning(fmt::format("{}; {} is removed to make room", error.what(), dropped->string()));
    }
}

void RunFiles::write_last(const std::filesystem::path& file, const Checkpoint& checkpoint, const std::function<void()>& waits) {
  const auto deadline = std::chrono::steady_clock::now() + patience_.last;
  for (bool has_logged = false;;) try {
      write_making_room(file, checkpoint);
      return;
    } catch (const RunError& error) {
      if (std::chrono::steady_clock::now() >= deadline) throw;
      if (!std::exchange(has_logged, true))
        log_error(fmt::format("{}; the last checkpoint (update {}) waits for room, {:.0f} s at most", error.what(), checkpoint.update,
                              std::chrono::duration<double>(patience_.last).count()));
      if (waits) waits();
      std::this_thread::sleep_for(patience_.look);
    }
}

std::uint64_t RunFiles::save(Checkpoint checkpoint, bool is_last, const std::function<void()>& waits) {
  const std::uint64_t failed = finish();
  const std::filesystem::path file = checkpoint_of(checkpoint.update, is_last);
  if (is_last) {
    write_last(file, checkpoint, waits);
    return failed + write_beside(file, checkpoint, true, true);
  }
  // The thread has a checkpoint of its own (its tensors are copies); of the rest it uses what no call touches before finish().
  writing_ = std::async(std::launch::async, [this, file, checkpoint = std::move(checkpoint)] {
    const bool is_whole = failures_of([&] { write_making_room(file, checkpoint); }) == 0;
    owes_checkpoint_ = !is_whole;
    return write_beside(file, checkpoint, is_whole, false);
  });
  return failed;
}

std::uint64_t RunFiles::finish() { return std::exchange(failed_before_, 0) + (writing_.valid() ? writing_.get() : 0); }

bool RunFiles::owes_checkpoint() {
  if (writing_.valid()) {
    if (writing_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return false;
    failed_before_ += writing_.get();
  }
  return owes_checkpoint_;
}

}  // namespace earshot
