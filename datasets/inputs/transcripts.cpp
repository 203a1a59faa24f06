// SPDX-License-Identifier: Apache-2.0
#include "datasets/inputs/transcripts.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/utf8.h"

namespace earshot {
namespace {

constexpr std::size_t kLongestTranscript = 1 << 16, kLongestList = std::size_t{256} << 20;
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF", kBlank = " \t\r\n\v\f", kListEnd = ".trans.txt";

std::string read_text(const std::filesystem::path& path, std::size_t most_bytes) {
  std::string text = read_file(path, most_bytes);
  if (!is_utf8(text)) throw InputError(path.string(), "is not UTF-8 text", "save it as UTF-8");
  return text;
}

/// Without a byte-order mark, and with line feeds for all ends of lines.
std::string with_line_feeds(std::string text) {
  if (text.starts_with(kByteOrderMark)) text.erase(0, kByteOrderMark.size());
  std::string clean;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool ends_with_line_feed = text[i] == '\r' && i + 1 < text.size() && text[i + 1] == '\n';
    if (!ends_with_line_feed) clean += text[i] == '\r' ? '\n' : text[i];
  }
  return clean;
}

/// The text file beside a speech file; empty without one.
std::optional<std::string> text_beside(const std::filesystem::path& sound) {
  for (const char* ending : {".txt", ".TXT"}) {
    std::filesystem::path path = sound;
    path.replace_extension(ending);
    std::error_code unknown;  // a link that leads nowhere is a text that cannot be read
    if (std::filesystem::exists(std::filesystem::symlink_status(path, unknown)))
      return clean_transcript(read_text(path, kLongestTranscript));
  }
  return {};
}

/// Texts by name, of the lists of one folder.
using NamedTexts = std::map<std::string, std::string>;

void read_list(const std::filesystem::path& path, NamedTexts& texts) {
  const std::string list = with_line_feeds(read_text(path, kLongestList));
  std::size_t number = 0;
  for (std::size_t begin = 0; begin < list.size();) {
    const std::size_t end = std::min(list.find('\n', begin), list.size());
    const std::string line = clean_transcript(list.substr(begin, end - begin));
    begin = end + 1;
    ++number;
    if (line.empty()) continue;
    const std::size_t name_end = std::min(line.find_first_of(" \t"), line.size());
    const std::string name = line.substr(0, name_end), text = clean_transcript(line.substr(name_end));
    const auto [at, is_added] = texts.emplace(name, text);
    if (!is_added && at->second != text)
      throw InputError(fmt::format("{}:{}", path.string(), number), fmt::format("has a second text for {}", name), "remove one of them");
  }
}

NamedTexts read_lists(const std::filesystem::path& folder) {
  NamedTexts texts;
  std::vector<std::filesystem::path> lists;
  std::error_code error;
  std::filesystem::directory_iterator at(folder, error);
  for (; !error && at != std::filesystem::directory_iterator(); at.increment(error))
    if (at->path().filename().string().ends_with(kListEnd)) lists.push_back(at->path());
  if (error) throw InputError(folder.string(), "cannot be listed: " + error.message(), "check the permissions of the folder");
  std::ranges::sort(lists);
  for (const std::filesystem::path& list : lists) read_list(list, texts);
  return texts;
}

}  // namespace

std::string clean_transcript(std::string text) {
  const std::string clean = with_line_feeds(std::move(text));
  const std::size_t begin = clean.find_first_not_of(kBlank);
  if (begin == std::string::npos) return {};
  return clean.substr(begin, clean.find_last_not_of(kBlank) - begin + 1);
}

Transcripts::Transcripts(const SoundFolder& speech) {
  std::map<std::filesystem::path, NamedTexts> lists;
  std::map<std::filesystem::path, std::set<std::string>> named;
  for (const std::string& file : speech.files) {
    const std::filesystem::path sound = speech.root / file, folder = sound.parent_path();
    if (!lists.contains(folder)) lists[folder] = read_lists(folder);
    const NamedTexts& of_folder = lists[folder];
    const auto listed = of_folder.find(sound.stem().string());
    if (listed != of_folder.end()) named[folder].insert(listed->first);
    try {
      if (auto text = text_beside(sound))
        texts_[file] = std::move(*text);
      else if (listed != of_folder.end())
        texts_[file] = listed->second;
    } catch (const InputError& error) {
      // Without the folder, so that records of other machines are the same.
      const std::string message = error.what(), root = (speech.root / "").string();
      unreadable_[file] = message.starts_with(root) ? message.substr(root.size()) : message;
    }
  }
  for (const auto& [folder, texts] : lists) unused_lines_ += texts.size() - named[folder].size();
}

std::optional<std::string> Transcripts::of(const std::string& file) const {
  const auto found = texts_.find(file);
  return found == texts_.end() ? std::nullopt : std::optional(found->second);
}

std::uint64_t Transcripts::hash(const SoundFolder& speech) const {
  std::string all;
  for (const std::string& file : speech.files)
    if (const auto text = of(file)) all += fmt::format("{} {}\n", file, hex64(hash64(*text)));
  return hash64(all);
}

}  // namespace earshot
