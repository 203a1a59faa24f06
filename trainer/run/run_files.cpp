#include "trainer/run/run_files.h"

#include <fmt/format.h>

#include <exception>
#include <utility>

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

RunFolder without_temporaries(const RunConfig& config) {
  RunFolder folder(config.out);
  folder.remove_temporaries();
  return folder;
}

}  // namespace

RunFiles::RunFiles(const RunConfig& config, std::uint64_t update)
    : config_(config), folder_(without_temporaries(config)), events_(config.out, update), checkpoints_(folder_, config.keep, update) {}

std::uint64_t RunFiles::write_point(const CurvePoint& point) {
  std::uint64_t failed = failures_of([&] { events_.write(point); });
  if (!config_.metrics_file.empty()) failed += failures_of([&] { write_metrics_file(config_.metrics_file, point, config_.name); });
  return failed;
}

std::filesystem::path RunFiles::checkpoint_of(std::uint64_t update, bool is_last) const {
  return is_last ? folder_.last_checkpoint() : folder_.checkpoint_of(update);
}

std::uint64_t RunFiles::write_beside(const std::filesystem::path& file, const Checkpoint& checkpoint, bool is_whole, bool is_last) {
  std::uint64_t failed = is_whole ? 0 : 1;
  if (is_whole) failed += failures_of([&] { checkpoints_.saved(file, checkpoint.update, checkpoint.mean_reward, is_last); });
  failed += failures_of([&] { write_file_atomically(folder_.curve(), curve_svg(config_.name, read_event_log(folder_.event_log()))); });
  return failed;
}

std::uint64_t RunFiles::save(Checkpoint checkpoint, bool is_last) {
  const std::uint64_t failed = finish();
  const std::filesystem::path file = checkpoint_of(checkpoint.update, is_last);
  if (is_last) {
    save_checkpoint(checkpoint, file);
    return failed + write_beside(file, checkpoint, true, true);
  }
  // The thread has a checkpoint of its own (its tensors are copies); of the rest it uses what no call touches before finish().
  writing_ = std::async(std::launch::async, [this, file, checkpoint = std::move(checkpoint)] {
    return write_beside(file, checkpoint, failures_of([&] { save_checkpoint(checkpoint, file); }) == 0, false);
  });
  return failed;
}

std::uint64_t RunFiles::finish() { return writing_.valid() ? writing_.get() : 0; }

}  // namespace earshot
