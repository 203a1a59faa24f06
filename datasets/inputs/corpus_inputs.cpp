// SPDX-License-Identifier: Apache-2.0
#include "datasets/inputs/corpus_inputs.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "datasets/corpus_threads.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/base/text/utf8.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMostNamed = 10, kLargestRecord = std::size_t{4} << 30;

/// A message without the folder of its file, so that records of other machines are the same.
std::string without_folder(std::string message, const std::filesystem::path& path, const std::string& name) {
  const std::string text = path.string();
  if (message.starts_with(text)) message.replace(0, text.size(), name);
  return message;
}

/// Empty: good.
std::string reason_of(const InputFile& file, float sample_rate_hz) {
  try {
    if (peak_of(load_sound(file.path, sample_rate_hz).samples) <= 0) return file.name + ": is silent; remove it from the folder";
  } catch (const InputError& error) {
    return without_folder(error.what(), file.path, file.name);
  }
  return {};
}

using RecordKey = std::pair<std::string, std::string>;
struct RecordedFile {
  std::uint64_t bytes = 0;
  std::string reason;
};

/// Of a corpus that is begun; a damaged record counts as none.
std::map<RecordKey, RecordedFile> read_record(const std::filesystem::path& path) {
  std::map<RecordKey, RecordedFile> record;
  std::error_code unknown;
  if (!std::filesystem::is_regular_file(path, unknown)) return record;
  const std::string text = read_file(path, kLargestRecord);
  try {
    for (std::size_t begin = 0; begin < text.size();) {
      const std::size_t end = std::min(text.find('\n', begin), text.size());
      const Json line = parse_ordered_json(std::string_view(text).substr(begin, end - begin));
      const Json& reason = line.at("left_out");
      record[{line.at("group").get<std::string>(), line.at("file").get<std::string>()}] = {
          line.at("bytes").get<std::uint64_t>(), reason.is_null() ? std::string() : reason.get<std::string>()};
      begin = end + 1;
    }
  } catch (const nlohmann::json::exception&) {
    record.clear();
  }
  return record;
}

}  // namespace

CorpusInputs::CorpusInputs(std::vector<InputFile> files, const std::filesystem::path& corpus, const InputRules& rules)
    : files_(std::move(files)), checked_(files_.size()), record_path_(corpus / "inputs.jsonl") {
  const std::map<RecordKey, RecordedFile> record = read_record(record_path_);
  std::vector<std::size_t> unopened;
  for (std::size_t i = 0; i < files_.size(); ++i) {
    std::error_code missing;
    const std::uintmax_t bytes = std::filesystem::file_size(files_[i].path, missing);
    checked_[i] = {.bytes = missing ? 0 : static_cast<std::uint64_t>(bytes), .reason = files_[i].reason};
    if (missing) checked_[i].reason = fmt::format("{}: cannot be read: {}; check the path", files_[i].name, missing.message());
    if (!is_utf8(files_[i].name))
      checked_[i].reason = files_[i].name + ": has a name that is not valid UTF-8, which the manifest needs; rename the file";
    if (!checked_[i].reason.empty()) continue;
    const auto found = record.find({files_[i].group, files_[i].name});
    if (found != record.end() && found->second.bytes == checked_[i].bytes)
      checked_[i].reason = found->second.reason;
    else
      unopened.push_back(i);
  }
  std::atomic<std::size_t> next = 0;
  CorpusThreads threads;
  if (!unopened.empty())
    threads.run(rules.threads, unopened.size(), unopened.size(), rules.progress, [&] {
      for (std::size_t at = next++; at < unopened.size() && !threads.failed(); at = next++) {
        checked_[unopened[at]].reason = reason_of(files_[unopened[at]], rules.sample_rate_hz);
        threads.count_item();
      }
    });
  if (rules.skip_bad || left_out() == 0) return;
  std::string named;
  std::size_t number = 0;
  for (std::size_t i = 0; i < files_.size(); ++i) {
    if (checked_[i].reason.empty() || ++number > kMostNamed) continue;
    // Reasons begin with the name of a sound or of its text, which the record gives without the folder.
    std::string folder = files_[i].path.string();
    folder.resize(folder.ends_with(files_[i].name) ? folder.size() - files_[i].name.size() : 0);
    named += (named.empty() ? "" : " | ") + folder + checked_[i].reason;
  }
  if (number > kMostNamed) named += fmt::format(" | {} more", number - kMostNamed);
  throw InputError(fmt::format("{} bad input file{}", number, number == 1 ? "" : "s"), named,
                   "--skip-bad leaves such files out and records them in inputs.jsonl");
}

std::vector<std::string> CorpusInputs::good(const std::string& group) const {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < files_.size(); ++i)
    if (files_[i].group == group && checked_[i].reason.empty()) names.push_back(files_[i].name);
  return names;
}

std::size_t CorpusInputs::left_out() const {
  return static_cast<std::size_t>(std::ranges::count_if(checked_, [](const Checked& checked) { return !checked.reason.empty(); }));
}

void CorpusInputs::record() const {
  if (files_.empty() || std::filesystem::exists(record_path_)) return;
  std::string text;
  for (std::size_t i = 0; i < files_.size(); ++i) {
    const Checked& checked = checked_[i];
    text += json_text_of_any_bytes(Json{{"group", files_[i].group},
                                        {"file", files_[i].name},
                                        {"bytes", checked.bytes},
                                        {"left_out", checked.reason.empty() ? Json(nullptr) : Json(checked.reason)}}) +
            "\n";
  }
  write_file_atomically(record_path_, text);
}

void require_outside(const std::filesystem::path& out, const std::filesystem::path& folder, const std::string& name) {
  std::error_code unknown;
  const std::filesystem::path inner = std::filesystem::weakly_canonical(std::filesystem::absolute(out), unknown),
                              outer = std::filesystem::weakly_canonical(std::filesystem::absolute(folder), unknown);
  const auto [in_outer, in_inner] = std::ranges::mismatch(outer, inner);
  const bool is_whole = in_outer == outer.end() || (std::next(in_outer) == outer.end() && in_outer->empty());
  if (is_whole)
    throw InputError("--out " + out.string(), fmt::format("lies in {}, which {} reads as a whole", folder.string(), name),
                     "name a place outside this folder");
}

}  // namespace earshot
