// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/quarantine.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <mutex>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <utility>

#include "envs/episodes/episode_set.h"
#include "envs/task/action_digits.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/base/text/json_depth.h"
#include "sim/base/text/json_number.h"
#include "sim/base/text/log.h"
#include "sim/base/text/schema_version.h"

namespace earshot {
namespace {

using nlohmann::json;

constexpr int kQuarantineVersion = 1;
constexpr std::size_t kMaxFileBytes = std::size_t{64} << 20;
constexpr const char* kRemedy = "name a file that a run wrote to its quarantine_dir";

constexpr std::array<std::string_view, kNumFaults> kNames = {"scene", "path",  "distance",    "reward",    "pose",  "depth",
                                                             "rir",   "sound", "spectrogram", "pointgoal", "stage", "stall"};

/// A name that is the same for the same fault of the same episode: one that cannot begin fails alike in every env, and needs one file.
std::string file_name(const QuarantineRecord& record) {
  std::uint64_t hash = hash64(episode_set_text({record.episode}), record.set_hash);
  if (record.step > 0) {
    hash = hash64(fmt::format("{} {} {}", record.seed, record.env, record.episode_count), hash);
    hash = hash64(std::as_bytes(std::span(record.actions)), hash);
    for (const auto& actions : record.others) hash = hash64(std::as_bytes(std::span(actions)), hash);
  }
  return fmt::format("{}_{}.json", name_of(record.report.fault), hex64(hash));
}

}  // namespace

std::string_view name_of(Fault fault) { return kNames[static_cast<std::size_t>(fault)]; }

std::optional<Fault> fault_by_name(std::string_view name) {
  for (std::size_t i = 0; i < kNumFaults; ++i)
    if (kNames[i] == name) return static_cast<Fault>(i);
  return std::nullopt;
}

std::uint64_t QuarantineCounters::total() const { return std::accumulate(episodes.begin(), episodes.end(), std::uint64_t{0}); }
std::uint64_t QuarantineCounters::nonfinite() const {
  std::uint64_t sum = 0;
  for (const Fault fault :
       {Fault::distance, Fault::reward, Fault::pose, Fault::depth, Fault::rir, Fault::sound, Fault::spectrogram, Fault::pointgoal})
    sum += of(fault);
  return sum;
}

std::string encode(const QuarantineRecord& record) {
  json document = {{"earshot_quarantine", kQuarantineVersion},
                   {"reason", name_of(record.report.fault)},
                   {"detail", record.report.detail},
                   {"engine", record.engine},
                   {"seed", record.seed},
                   {"env", record.env},
                   {"episode_count", record.episode_count},
                   {"set_hash", hex64(record.set_hash)},
                   {"episode_index", record.episode_index},
                   {"step", record.step},
                   {"set", parse_json(episode_set_text({record.episode}))},
                   {"config", record.config}};
  write_actions(document, record.actions, record.others);
  return json_text_of_any_bytes(document, 1) + "\n";
}

QuarantineRecord decode_quarantine_record(std::string_view text, const std::string& where) {
  const auto fail = [&](const std::string& problem) { throw InputError(where, problem, kRemedy); };
  check_json_depth(text, where);
  QuarantineRecord record;
  try {
    const json document = parse_json(text);
    if (!document.is_object() || !document.contains("earshot_quarantine")) fail("is not a quarantined episode");
    check_schema_version(document, "earshot_quarantine", where, "a quarantined episode", {kQuarantineVersion, kQuarantineVersion});
    const auto reason = document.at("reason").get<std::string>();
    const auto fault = fault_by_name(reason);
    if (!fault) fail("has an unknown reason '" + reason + "'");
    record.report = {*fault, document.at("detail").get<std::string>()};
    record.engine = document.at("engine").get<std::string>();
    record.seed = whole_number<std::uint64_t>(document, "seed");
    record.env = whole_number<int>(document, "env");
    record.episode_count = whole_number<int>(document, "episode_count");
    record.set_hash = std::stoull(document.at("set_hash").get<std::string>(), nullptr, 16);
    record.episode_index = whole_number<std::uint64_t>(document, "episode_index");
    record.step = whole_number<int>(document, "step");
    read_actions(document, record.actions, record.others, fail);
    record.config = document.at("config").get<std::string>();
    const EpisodeSet set = parse_episode_set(json_text(document.at("set")), where);
    if (set.episodes.size() != 1) fail("does not contain exactly one episode");
    record.episode = set.episodes.front();
  } catch (const json::exception& error) {
    fail(std::string("cannot be read: ") + error.what());
  } catch (const std::logic_error&) {  // std::stoull
    fail("cannot be read: set_hash is not a hexadecimal number");
  }
  constexpr int kMaxEnvs = 1 << 30;
  if (record.env < 0 || record.env > kMaxEnvs) fail("contains an invalid env");
  if (record.episode_count < 0 || record.episode_count > kMaxEnvs) fail("contains an invalid episode_count");
  std::size_t longest = record.actions.size();
  for (const auto& actions : record.others) longest = std::max(longest, actions.size());
  if (record.step < 0 || static_cast<std::size_t>(record.step) > longest) fail("contains fewer actions than steps");
  return record;
}

QuarantineRecord load_quarantine_record(const std::filesystem::path& path) {
  return decode_quarantine_record(read_file(path, kMaxFileBytes), path.string());
}

struct Quarantine::Impl {
  std::filesystem::path folder;
  std::uint64_t max_files = 0;
  mutable std::mutex mutex;  // guards everything below
  QuarantineCounters counters;
  std::set<std::string> written;
  bool warned = false;

  void write(const QuarantineRecord& record) {
    const std::string name = file_name(record);
    if (written.size() >= max_files || !written.insert(name).second) {
      ++counters.files_left_out;
      return;
    }
    try {
      write_file_atomically(folder / name, encode(record));
      ++counters.files_written;
    } catch (const std::exception& error) {
      ++counters.files_failed;
      if (!std::exchange(warned, true))
        log_warning(fmt::format("quarantined episodes are counted but cannot be written (reported once): {}", error.what()));
    }
  }
};

Quarantine::Quarantine(std::filesystem::path folder, std::uint64_t max_files) : impl_(std::make_unique<Impl>()) {
  impl_->folder = std::move(folder);
  impl_->max_files = max_files;
}
Quarantine::~Quarantine() = default;

void Quarantine::add(const QuarantineRecord& record) {
  Impl& in = *impl_;
  const std::scoped_lock lock(in.mutex);
  const std::uint64_t count = ++in.counters.episodes[static_cast<std::size_t>(record.report.fault)];
  if (std::has_single_bit(count))
    log_error(fmt::format("quarantined episode (number {} for this reason): {} at step {} of episode '{}' in {}, env {}, seed {}: {}",
                          count, name_of(record.report.fault), record.step, record.episode.episode_id, record.episode.scene_id, record.env,
                          record.seed, record.report.detail));
  if (!in.folder.empty()) in.write(record);
}

QuarantineCounters Quarantine::counters() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->counters;
}

}  // namespace earshot
