// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "evaluation/leaderboard/private_gap.h"
#include "evaluation/results/result.h"

namespace earshot {

/// Texts of a result page besides the results.
struct BoardPage {
  std::string benchmark = {};  ///< name and version; empty: none
  /// Address and text of pages that belong to it.
  std::vector<std::pair<std::string, std::string>> links = {};
  /// The same of replays, by agent.
  std::map<std::string, std::vector<std::pair<std::string, std::string>>> replays = {};
  std::vector<PrivateScore> private_scores = {};
};

/// One HTML file that needs no network and no script: the table with intervals and bars, of each agent its track and what its numbers rest
/// on, public and private numbers beside each other, and success and SPL by novelty and kind of the sound, size of the scene, distance and
/// scene, where the results hold it.
std::string leaderboard_page(const std::vector<EvaluationResult>& results, const BoardPage& page);

}  // namespace earshot
