// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "evaluation/results/result.h"

namespace earshot {

/// Results ranked by SPL, then success, then name: rank 1 first.  Where they stand on a board: track by track, by the
/// names of the tracks, then those that are shown apart.
std::vector<EvaluationResult> ranked(std::vector<EvaluationResult> results);

/// Rank of each of the rows that ranked() gives, from 1 in each track; 0: shown apart, without a rank.
std::vector<int> ranks_of(const std::vector<EvaluationResult>& rows);

/// The table for a terminal: one row per agent, each metric with its 95 % interval; a note when the agents ran different sets or engines.
std::string leaderboard_text(const std::vector<EvaluationResult>& results);

/// The same as JSON with a schema_version (docs/reference/json_output.md).
std::string leaderboard_json(const std::vector<EvaluationResult>& results);

/// A column of tables of agents.
struct BoardColumn {
  const char* title;
  Estimate (*get)(const EvaluationResult&);
  int digits;
};
const std::vector<BoardColumn>& board_columns();
/// How the intervals were made, in words.
std::string interval_kind(const std::vector<EvaluationResult>& results);
bool any_verified(const std::vector<EvaluationResult>& results);
/// Differences that make the rows hard to compare, or empty.
std::vector<std::string> board_notes(const std::vector<EvaluationResult>& results);

}  // namespace earshot
