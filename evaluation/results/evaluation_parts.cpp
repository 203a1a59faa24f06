// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/evaluation_parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

constexpr const char* kSettings = "evaluation.txt";

/// The first line of `here` that `there` does not have in its place.
std::pair<std::string, std::string> first_difference(const std::string& there, const std::string& here) {
  const auto line_at = [](const std::string& text, std::size_t at) {
    const std::size_t begin = at == 0 ? 0 : text.rfind('\n', at - 1) + 1;
    return begin >= text.size() ? std::string("nothing") : text.substr(begin, text.find('\n', begin) - begin);
  };
  const auto at = static_cast<std::size_t>(std::mismatch(there.begin(), there.end(), here.begin(), here.end()).first - there.begin());
  return {line_at(there, at), line_at(here, at)};
}

/// Writes the file unless another process has: of two evaluations that begin together the second finds the first.
void leave_first(const std::filesystem::path& path, const std::string& text) {
  const std::filesystem::path own = fmt::format("{}.{}", path.string(), hex64(hash64(text)));
  write_file_atomically(own, text);
  std::error_code no_link, ignored;
  std::filesystem::create_hard_link(own, path, no_link);
  std::filesystem::remove(own, ignored);
  // A file system without links.
  if (no_link && !std::filesystem::exists(path)) write_file_atomically(path, text);
}

}  // namespace

EvaluationResult join_evaluation_parts(const std::vector<std::filesystem::path>& files, const std::string& what) {
  EvaluationResult whole;
  for (std::size_t i = 0; i < files.size(); ++i) {
    EvaluationResult part = load_result(files[i]);
    if (i == 0) {
      whole = std::move(part);
      continue;
    }
    if (part.set_hash != whole.set_hash || part.episodes.size() != whole.episodes.size() || part.policy_hash != whole.policy_hash ||
        part.senses != whole.senses || part.agent != whole.agent || part.rules != whole.rules)
      throw RunError(what, "the workers read different episodes, weights or configs: a file was changed during the evaluation");
    for (std::size_t row = 0; row < part.episodes.size(); ++row)
      if (!part.episodes[row].scene.empty()) whole.episodes[row] = std::move(part.episodes[row]);
  }
  for (const auto& row : whole.episodes)
    if (row.scene.empty()) throw RunError(what, "the workers left out an episode");
  return whole;
}

EvaluationParts::EvaluationParts(std::filesystem::path folder, int count, const std::string& settings)
    : folder_(std::move(folder)), count_(count) {
  const std::filesystem::path path = folder_ / kSettings;
  const std::string text = fmt::format("parts: {}\n{}", count, settings);
  if (!std::filesystem::exists(path)) {
    if (std::filesystem::exists(folder_) && !std::filesystem::is_directory(folder_))
      throw InputError(folder_.string(), "is not a folder", "give a folder for --parts");
    leave_first(path, text);
  }
  const std::string found = read_file(path);
  if (found == text) return;
  const auto [there, here] = first_difference(found, text);
  throw InputError(folder_.string(), fmt::format("has parts of another evaluation: '{}' there, '{}' here", there, here),
                   "repeat the command of its parts, or use another folder");
}

std::filesystem::path EvaluationParts::file(int part) const { return folder_ / fmt::format("part_{}.json", part + 1); }

bool EvaluationParts::has(int part) const { return std::filesystem::exists(file(part)); }

void EvaluationParts::save(int part, const EvaluationResult& result) const { save_result(result, file(part)); }

int EvaluationParts::missing() const {
  int missing = 0;
  for (int part = 0; part < count_; ++part) missing += !has(part);
  return missing;
}

EvaluationResult EvaluationParts::join() const {
  std::vector<std::filesystem::path> files;
  for (int part = 0; part < count_; ++part) files.push_back(file(part));
  return join_evaluation_parts(files, "eval --parts");
}

}  // namespace earshot
