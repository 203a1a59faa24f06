// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/set_of_result.h"

#include <fmt/format.h>

#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/output_paths.h"
#include "sim/base/text/listed.h"

namespace earshot {

EpisodeSet set_of_result(const EvaluationResult& result, const std::string& where, const std::vector<std::filesystem::path>& folders) {
  const std::filesystem::path named = result.episodes_file;
  std::vector<std::string> names;
  for (const std::filesystem::path& folder : folders) {
    names.push_back(folder.string());
    for (const std::filesystem::path& file : {named, folder / named.relative_path(), folder / named.filename()}) {
      std::error_code error;
      if (std::filesystem::is_regular_file(file, error) && is_inside(file, folder)) return load_episode_set(file);
    }
  }
  throw InputError(where,
                   fmt::format("names the episode set '{}', which is not in {}{}", result.episodes_file, listed(names, " or "),
                               names.empty() ? "a folder that was given" : ""),
                   "name the set with --episodes FILE, or its folder with --episodes FOLDER");
}

std::vector<std::filesystem::path> folders_near(const std::string& result_file) {
  const std::filesystem::path beside = std::filesystem::path(result_file).parent_path();
  return {".", beside.empty() ? "." : beside};
}

}  // namespace earshot
