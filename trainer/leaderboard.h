#pragma once

#include <string>
#include <utility>
#include <vector>

#include "trainer/result.h"

namespace earshot {

/// Results ranked by SPL, then success, then name: rank 1 first.
std::vector<EvaluationResult> ranked(std::vector<EvaluationResult> results);

/// The table for a terminal: one row per agent, each metric with its 95 % interval; a note when the agents ran different sets or engines.
std::string leaderboard_text(const std::vector<EvaluationResult>& results);

/// The same as JSON with a schema_version (docs/formats.md).
std::string leaderboard_json(const std::vector<EvaluationResult>& results);

/// The same as a self-contained HTML page with a bar per agent for success and SPL.  links: address and text of pages that belong to it.
std::string leaderboard_html(const std::vector<EvaluationResult>& results,
                             const std::vector<std::pair<std::string, std::string>>& links = {});

}  // namespace earshot
