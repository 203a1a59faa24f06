// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/run_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "sim/base/errors.h"
#include "trainer/checkpoint/find_checkpoint.h"

namespace earshot {
namespace {

constexpr std::string_view kPrefix = "update_", kSuffix = ".ckpt";

/// 150 of "update_000150.ckpt".
std::optional<std::uint64_t> update_of(std::string_view name) {
  if (!name.starts_with(kPrefix) || !name.ends_with(kSuffix)) return std::nullopt;
  name.remove_prefix(kPrefix.size());
  name.remove_suffix(kSuffix.size());
  std::uint64_t update = 0;
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), update);
  if (error != std::errc() || end != name.data() + name.size()) return std::nullopt;
  return update;
}

bool is_checkpoint_of_a_run(const std::string& name) { return name == "last.ckpt" || name == "best.ckpt" || update_of(name); }

/// FAULT_0123456789abcdef.json, see quarantine.h.
bool is_quarantined_episode(std::string_view name) {
  constexpr std::string_view ending = ".json";
  constexpr std::size_t digits = 16;
  if (!name.ends_with(ending) || name.size() < digits + ending.size() + 2) return false;
  const std::string_view hash = name.substr(name.size() - ending.size() - digits, digits);
  return name[name.size() - ending.size() - digits - 1] == '_' && hash.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

/// Plain files in a folder by name; none if it is not there.
std::vector<std::filesystem::path> files_in(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  if (!std::filesystem::is_directory(folder)) return files;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (!entry.is_directory()) files.push_back(entry.path());
  std::ranges::sort(files);
  return files;
}

void remove_if_empty(const std::filesystem::path& folder) {
  if (std::filesystem::is_directory(folder) && std::filesystem::is_empty(folder)) std::filesystem::remove(folder);
}

}  // namespace

std::filesystem::path RunFolder::checkpoint_of(std::uint64_t update) const {
  return out_ / "checkpoints" / fmt::format("{}{:06}{}", kPrefix, update, kSuffix);
}

std::vector<std::filesystem::path> RunFolder::checkpoints() const {
  std::vector<std::filesystem::path> found;
  for (const auto& folder : {out_, out_ / "checkpoints"})
    for (const auto& file : files_in(folder))
      if (file.extension() == kSuffix) found.push_back(file);
  return found;
}

void RunFolder::remove_run() const {
  std::vector<std::filesystem::path> files;
  for (const auto& file : checkpoints()) {
    if (file.parent_path() == out_ || !is_checkpoint_of_a_run(file.filename().string()))
      throw InputError(file.string(),
                       "does not belong to the run in this folder, and the new run would mistake it for one of its own checkpoints",
                       "move it to another folder");
    files.push_back(file);
  }
  for (const auto& file : files_in(out_)) {
    const std::string name = file.filename().string();
    if (name == "events.jsonl" || name == "curve.svg" || name.starts_with("events.out.tfevents.")) files.push_back(file);
  }
  for (const auto& file : files_in(out_ / "quarantine"))
    if (is_quarantined_episode(file.filename().string())) files.push_back(file);
  for (const auto& file : files) std::filesystem::remove(file);
  remove_if_empty(out_ / "checkpoints");
  remove_if_empty(out_ / "quarantine");
}

void RunFolder::remove_temporaries() const {
  for (const auto& file : files_in(out_ / "checkpoints"))
    if (file.filename().string().find(".ckpt.tmp") != std::string::npos) std::filesystem::remove(file);
}

std::optional<std::filesystem::path> RunFolder::drop_oldest() const {
  std::map<std::uint64_t, std::filesystem::path> by_update;
  for (const auto& file : files_in(out_ / "checkpoints"))
    if (const auto update = update_of(file.filename().string())) by_update.emplace(*update, file);
  if (by_update.empty()) return std::nullopt;
  const auto [oldest, file] = *by_update.begin();
  std::vector<std::filesystem::path> newer{last_checkpoint()};
  for (auto item = by_update.rbegin(); item != by_update.rend() && item->first > oldest; ++item) newer.push_back(item->second);
  for (const auto& other : newer)
    if (std::filesystem::exists(other)) try {
        if (load_checkpoint_metadata(other).update <= oldest) continue;
        std::filesystem::remove(file);
        return file;
      } catch (const InputError&) {  // damaged: no reason to drop another
      }
  return std::nullopt;
}

void RunFolder::remove_surplus(std::uint64_t update, int keep, bool is_last) const {
  std::map<std::uint64_t, std::filesystem::path> by_update;
  for (const auto& file : files_in(out_ / "checkpoints"))
    if (const auto file_update = update_of(file.filename().string())) by_update.emplace(*file_update, file);
  int kept = 0;
  for (auto item = by_update.rbegin(); item != by_update.rend(); ++item)
    if (item->first > update || ++kept > keep) std::filesystem::remove(item->second);
  if (!is_last) std::filesystem::remove(last_checkpoint());
}

std::filesystem::path run_folder_of(const std::filesystem::path& checkpoint) {
  const auto folder = std::filesystem::weakly_canonical(checkpoint).parent_path();
  return folder.filename() == "checkpoints" ? folder.parent_path() : folder;
}

}  // namespace earshot
