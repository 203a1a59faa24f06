// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "envs/episodes/episode_set.h"
#include "evaluation/results/result.h"

namespace earshot {

/// What a sound is one of: "telephone" of `synth:telephone:3`, "recording" of a file.
std::string sound_kind(std::string_view sound);

/// Notes in each row what its sound was to the training: "heard", "unheard" (another of a kind that was heard) or "unheard kind".
/// trained: the sounds of data.train, without ranges or folders (expand_sounds).
void note_novelty(EvaluationResult& result, std::span<const std::string> trained);

/// Floor of a scene: of a generated house the floor of its rooms, else the extent of the mesh along x times that along z.  Throws
/// InputError if it cannot be loaded.
double floor_area_m2(const std::string& scene, const std::string& scene_root);
/// floor_area_m2 of scenes below one root, each of which is loaded once.
class FloorAreas {
 public:
  explicit FloorAreas(std::string scene_root) : scene_root_(std::move(scene_root)) {}
  double of(const std::string& scene);

 private:
  std::string scene_root_;
  std::map<std::string, double> areas_m2_;
};

/// Notes in each row the floor of its scene and the distance from its start to its goal.  set: that of the result, or the one that a
/// partial result is of.  Returns false and changes nothing for a set with another hash.
bool note_places(EvaluationResult& result, const EpisodeSet& set, FloorAreas& areas);

/// By what the episodes of a result are told apart.  size: floor of the scene in classes of 50 m2; distance: of start and goal on foot,
/// below 3 m, 6 m, 12 m, and above.
enum class GroupBy { novelty, kind, size, distance, scene };

/// The episodes of a result by group, each as a result of its own, in the order in which tables have them.  Throws InputError for a result
/// without what they are to be told apart by.
std::vector<std::pair<std::string, EvaluationResult>> groups_of(const EvaluationResult& result, GroupBy by);
/// Whether the result holds what groups_of needs.
bool can_group(const EvaluationResult& result, GroupBy by);

/// Success, success when silent and SPL of each agent by group, with the number of episodes and their fraction of all: a table of text.
/// Throws InputError as groups_of.
std::string groups_text(const std::vector<EvaluationResult>& results, GroupBy by);

}  // namespace earshot
