// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/held_out_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "envs/episodes/episode_set.h"
#include "evaluation/results/split_overlap.h"
#include "sim/base/errors.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/log.h"
#include "trainer/run/episode_data.h"

namespace earshot {
namespace {

constexpr std::size_t kNamed = 5;  // of scenes in a message; of the others the number

std::vector<std::string> scenes_of(const EpisodeSet& set) {
  std::vector<std::string> scenes;
  for (const Episode& episode : set.episodes) scenes.push_back(episode.scene_id);
  std::ranges::sort(scenes);
  scenes.erase(std::unique(scenes.begin(), scenes.end()), scenes.end());
  return scenes;
}

std::string named(const std::vector<std::string>& scenes) {
  const std::vector<std::string> first(scenes.begin(), scenes.begin() + static_cast<std::ptrdiff_t>(std::min(kNamed, scenes.size())));
  const std::string more = scenes.size() > kNamed ? fmt::format(" and {} more", scenes.size() - kNamed) : "";
  return listed(first, ", ") + more;
}

/// Those of the final evaluation, as far as config or file say.
std::vector<std::string> evaluated_scenes(const DataConfig& eval) {
  std::vector<std::string> scenes;
  for (const std::string& scene : eval.scenes)
    for (std::string& one : expand_range(scene)) scenes.push_back(std::move(one));
  if (scenes.empty() && !eval.file.empty() && std::filesystem::exists(eval.file)) return scenes_of(load_episode_set(eval.file));
  return scenes;
}

void refuse_near_duplicates(const std::vector<std::string>& trained, const std::vector<std::string>& held_out, const RunConfig& config) {
  if (trained.size() + held_out.size() > kMaxComparedScenes) {
    log_warning(fmt::format("data.held_out: {} scenes are compared with those of the training by name alone", held_out.size()));
    return;
  }
  if (const auto found = find_scene_overlap(trained, held_out, config.env.scene_root))
    throw InputError(config.held_out_data.file, fmt::format("has {}, {} {} of the training set", found->tested, found->why, found->trained),
                     "leave it out of data.held_out.scenes or of data.train.scenes, and write the episodes again");
}

}  // namespace

void check_held_out(const RunConfig& config, const std::string& remake, HeldOutCheck how) {
  if (!config.held_out.is_on()) return;
  const std::string& file = config.held_out_data.file;
  if (!std::filesystem::exists(file)) throw InputError(file, "does not exist", "write the episode set with '" + remake + "'");
  const EpisodeSet set = load_episode_set(file);
  check_generator(set, expected_generator(config.held_out_data, config.env), file,
                  "write it again with '" + remake + "', or remove data.held_out.scenes from the config to use the file unchanged");
  if (set.episodes.empty()) throw InputError(file, "has no episodes", "raise data.held_out.episodes_per_scene");
  const std::vector<std::string> held_out = scenes_of(set), trained = scenes_of(load_episode_set(config.train.file));
  if (const auto shared = shared_scenes(trained, held_out); !shared.empty())
    throw InputError(file, fmt::format("has {} that the run trains in: {}", shared.size() == 1 ? "a scene" : "scenes", named(shared)),
                     "leave them out of data.held_out.scenes or of data.train.scenes, and write the episodes again");
  if (how == HeldOutCheck::names) return;
  refuse_near_duplicates(trained, held_out, config);
  if (const auto shared = shared_scenes(evaluated_scenes(config.eval), held_out); !shared.empty())
    log_warning(fmt::format("{} shares scenes with data.eval: {}; best.ckpt is chosen by them, so that its success there is too high", file,
                            named(shared)));
}

}  // namespace earshot
