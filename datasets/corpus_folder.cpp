// SPDX-License-Identifier: Apache-2.0
#include "datasets/corpus_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>
#include <utility>

#include "sim/base/engine_commit.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/part_file.h"
#include "sim/base/text/json.h"
#include "sim/base/text/schema_version.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

[[noreturn]] void fail(const std::filesystem::path& path, const char* operation) {
  throw RunError(path.string(), std::string(operation) + ": " + std::generic_category().message(errno));
}

/// Closes a descriptor on every way out.
class Descriptor {
 public:
  Descriptor(const std::filesystem::path& path, int flags) : value_(::open(path.c_str(), flags | O_CLOEXEC, 0644)) {
    if (value_ < 0) fail(path, "cannot be opened");
  }
  ~Descriptor() { ::close(value_); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int value() const { return value_; }

 private:
  int value_;
};

void flush_to_disk(const std::filesystem::path& path, int flags) {
  const Descriptor file(path, flags);
  if (::fsync(file.value()) != 0) fail(path, "cannot be flushed");
}

void create_folder(const std::filesystem::path& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) throw RunError(path.string(), "cannot be created: " + error.message());
}

/// The first line that two texts do not have in common, of each.
std::pair<std::string, std::string> first_difference(std::string_view a, std::string_view b) {
  const auto cut = [](std::string_view& text) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    return line;
  };
  while (!a.empty() || !b.empty()) {
    const std::string_view left = cut(a), right = cut(b);
    if (left != right) return {std::string(left), std::string(right)};
  }
  return {};
}

std::string trimmed(const std::string& text) {
  const std::size_t begin = text.find_first_not_of(' ');
  return begin == std::string::npos ? "nothing" : text.substr(begin);
}

/// corpus.json as lines with one key each, the config among them.
std::string as_lines(const std::string& json, const std::string& where) {
  try {
    const Json parsed = parse_ordered_json(json);
    check_schema_version(parsed, kCorpusVersionKey, where, "a corpus", {1, kCorpusVersion});
    std::string lines;
    for (const auto& [key, value] : parsed.items())
      lines += key == "config" ? value.get<std::string>() : fmt::format("{}: {}\n", key, json_text(value));
    return lines;
  } catch (const nlohmann::json::exception&) {
    throw InputError(where, "is corrupted", "delete this file if the folder contains no corpus that you want to complete");
  }
}

/// Lines without those of `keys`.
std::string without(const std::string& lines, const std::set<std::string>& keys) {
  std::string kept;
  for (std::size_t begin = 0; begin < lines.size();) {
    const std::size_t end = std::min(lines.find('\n', begin), lines.size() - 1) + 1;
    const std::string line = lines.substr(begin, end - begin);
    if (!keys.contains(line.substr(0, line.find(':')))) kept += line;
    begin = end;
  }
  return kept;
}

}  // namespace

CorpusFolder::CorpusFolder(std::filesystem::path out, std::size_t num_rooms, std::size_t rooms_per_folder, float sample_rate_hz,
                           std::size_t num_channels, std::filesystem::path files_below)
    : out_(std::move(out)),
      num_rooms_(num_rooms),
      rooms_per_folder_(rooms_per_folder),
      sample_rate_hz_(sample_rate_hz),
      num_channels_(num_channels),
      files_below_(std::move(files_below)) {}

void CorpusFolder::begin(const std::string& description) const {
  const std::filesystem::path path = out_ / "corpus.json";
  if (!std::filesystem::exists(path)) {
    if (std::filesystem::exists(out_) && !std::filesystem::is_directory(out_))
      throw InputError(out_.string(), "is not a folder", "give a folder to write");
    write_file_atomically(path, description);
    return;
  }
  if (read_file(path) == description) return;
  refuse_others(out_, description, {});
}

void CorpusFolder::refuse_others(const std::filesystem::path& out, const std::string& description, const std::set<std::string>& of_files) {
  const std::filesystem::path path = out / "corpus.json";
  std::error_code unknown;
  if (!std::filesystem::exists(path, unknown)) return;
  const auto [old_line, line] = first_difference(without(as_lines(read_file(path), path.string()), of_files),
                                                 without(as_lines(description, path.string()), of_files));
  if (old_line == line) return;
  throw InputError(
      out.string(),
      fmt::format("contains a corpus that was started with other settings: '{}' there, '{}' here", trimmed(old_line), trimmed(line)),
      "complete it with the same config and program, or use another folder");
}

std::filesystem::path CorpusFolder::folder_path(std::size_t folder) const {
  return (files_below_.empty() ? out_ : out_ / "parts") / fmt::format("{:05}", folder);
}
std::filesystem::path CorpusFolder::file_path(std::size_t room, const std::string& name) const {
  return (files_below_.empty() ? folder_path(room / rooms_per_folder_) : files_below_) / name;
}
std::filesystem::path CorpusFolder::part_path(std::size_t room) const {
  return folder_path(room / rooms_per_folder_) / fmt::format("room_{:06}.jsonl", room);
}
std::string CorpusFolder::prefix_of(std::size_t room) const {
  return files_below_.empty() ? fmt::format("{:05}/", room / rooms_per_folder_) : std::string();
}
std::size_t CorpusFolder::end_room(std::size_t folder) const { return std::min(num_rooms_, first_room(folder + 1)); }

std::vector<std::size_t> CorpusFolder::missing_rooms(std::size_t folder) const {
  std::vector<std::size_t> missing;
  const bool whole = is_complete(folder);
  for (std::size_t room = first_room(folder); room < end_room(folder); ++room)
    if (!whole && !std::filesystem::exists(part_path(room))) missing.push_back(room);
  create_folder(folder_path(folder));
  if (missing.empty()) complete(folder);
  return missing;
}

void CorpusFolder::write_sound(std::size_t room, const std::string& name, std::string_view bytes) const {
  PartFile file(file_path(room, name));  // a reader of the folder finds whole files only
  file.append(bytes);
  file.keep();
}

void CorpusFolder::finish_room(std::size_t room, const std::vector<std::string>& files, const std::string& lines) const {
  const std::size_t folder = room / rooms_per_folder_;
  std::set<std::filesystem::path> folders;
  for (const std::string& name : files) {
    const std::filesystem::path path = file_path(room, name);
    flush_to_disk(path, O_RDONLY);
    folders.insert(path.parent_path());
  }
  for (const std::filesystem::path& path : folders) flush_to_disk(path, O_RDONLY | O_DIRECTORY);
  const std::lock_guard lock(completing_);
  write_file_atomically(part_path(room), lines);
  for (std::size_t other = first_room(folder); other < end_room(folder); ++other)
    if (!std::filesystem::exists(part_path(other))) return;
  complete(folder);
}

void CorpusFolder::complete(std::size_t folder) const {
  if (!is_complete(folder)) {
    std::string lines;
    for (std::size_t room = first_room(folder); room < end_room(folder); ++room) lines += read_file(part_path(room));
    write_file_atomically(manifest_path(folder), lines);
  }
  std::error_code ignored;
  for (std::size_t room = first_room(folder); room < end_room(folder); ++room) std::filesystem::remove(part_path(room), ignored);
  for (const auto& entry : std::filesystem::directory_iterator(folder_path(folder)))
    if (entry.path().filename().string().find(".jsonl.tmp") != std::string::npos) std::filesystem::remove(entry.path(), ignored);
}

std::string CorpusFolder::recording_line(const std::string& manifest_line) const {
  const Json response = parse_ordered_json(manifest_line);
  Json channels = Json::array();
  for (std::size_t channel = 0; channel < num_channels_; ++channel) channels.push_back(channel);
  const auto samples = response.at("num_samples").get<std::uint64_t>();
  return json_text(Json{{"id", response.at("id")},
                        {"sources", Json::array({{{"type", "file"}, {"channels", channels}, {"source", response.at("file")}}})},
                        {"sampling_rate", static_cast<int>(sample_rate_hz_)},
                        {"num_samples", samples},
                        {"duration", static_cast<double>(samples) / static_cast<double>(sample_rate_hz_)},
                        {"channel_ids", channels}});
}

std::string CorpusFolder::describe(const std::string& kind, const std::string& config, float sample_rate_hz,
                                   const std::vector<std::string>& channels) {
  const Json json = {
      {kCorpusVersionKey, kCorpusVersion}, {"kind", kind},    {"engine", engine_commit() + " " + build_type()}, {"channels", channels},
      {"sample_rate_hz", sample_rate_hz},  {"config", config}};
  return json_text(json, 1) + "\n";
}

std::size_t CorpusFolder::join_manifests(const std::vector<DerivedManifest>& derived) const {
  std::size_t missing = 0;
  for (std::size_t folder = 0; folder < count(); ++folder) missing += !is_complete(folder);
  if (missing > 0) return missing;
  // Folder by folder: the manifest of a large grid does not fit into memory.
  PartFile all(out_ / "manifest.jsonl");
  std::vector<std::pair<std::unique_ptr<PartFile>, std::function<std::string(const std::string&)>>> lists;
  const auto add_list = [&](const std::string& name, std::function<std::string(const std::string&)> lines) {
    lists.emplace_back(std::make_unique<PartFile>(out_ / name), std::move(lines));
  };
  if (num_channels_ > 0) add_list("recordings.jsonl", [this](const std::string& line) { return recording_line(line) + "\n"; });
  for (const DerivedManifest& list : derived) add_list(list.name, list.lines);
  for (std::size_t folder = 0; folder < count(); ++folder) {
    const std::string lines = read_file(manifest_path(folder));
    all.append(lines);
    std::vector<std::string> of_folder(lists.size());
    for (std::size_t begin = 0; begin < lines.size();) {
      const std::size_t end = std::min(lines.find('\n', begin), lines.size());
      const std::string line = lines.substr(begin, end - begin);
      for (std::size_t i = 0; i < lists.size(); ++i) of_folder[i] += lists[i].second(line);
      begin = end + 1;
    }
    for (std::size_t i = 0; i < lists.size(); ++i) lists[i].first->append(of_folder[i]);
  }
  all.flush();
  for (const auto& [file, lines] : lists) file->flush();
  all.keep();
  for (const auto& [file, lines] : lists) file->keep();
  flush_to_disk(out_, O_RDONLY | O_DIRECTORY);
  return 0;
}

}  // namespace earshot
