// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/leaderboard.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "sim/base/text/json.h"

namespace earshot {
namespace {

std::string cell(const Estimate& estimate, int digits) {
  return fmt::format("{:.{}f} [{:.{}f}, {:.{}f}]", estimate.mean, digits, estimate.low, digits, estimate.high, digits);
}

/// Of the rules those that ranked numbers depend on.
std::map<std::string, std::string> ranked_rules(const EvaluationResult& result) {
  std::map<std::string, std::string> rules = result.rules;
  std::erase_if(rules, [](const auto& rule) {
    return rule.first.ends_with("_reward") || !(rule.first.starts_with("task.") || rule.first.starts_with("navmesh."));
  });
  return rules;
}

}  // namespace

const std::vector<BoardColumn>& board_columns() {
  static const std::vector<BoardColumn> all{{"success", [](const EvaluationResult& r) { return r.success(); }, 3},
                                            {"SPL", [](const EvaluationResult& r) { return r.spl(); }, 3},
                                            {"SoftSPL", [](const EvaluationResult& r) { return r.soft_spl(); }, 3},
                                            {"SNA", [](const EvaluationResult& r) { return r.sna(); }, 3},
                                            {"DTG m", [](const EvaluationResult& r) { return r.dtg_m(); }, 2},
                                            {"steps", [](const EvaluationResult& r) { return r.steps(); }, 0},
                                            {"collisions", [](const EvaluationResult& r) { return r.collisions(); }, 1}};
  return all;
}

std::string interval_kind(const std::vector<EvaluationResult>& results) {
  const bool over_scenes = std::ranges::all_of(results, [](const auto& result) { return result.intervals_over_scenes(); });
  return over_scenes ? "bootstrap over scenes" : "over episodes: Wilson for success, else Student's t";
}

bool any_verified(const std::vector<EvaluationResult>& results) { return std::ranges::any_of(results, &EvaluationResult::verified); }

std::vector<std::string> board_notes(const std::vector<EvaluationResult>& results) {
  std::vector<std::string> all;
  const auto differ = [&](auto get) { return std::ranges::any_of(results, [&](const auto& r) { return get(r) != get(results.front()); }); };
  if (differ([](const auto& r) { return r.set_hash; }))
    all.emplace_back("the agents ran different episode sets, so the rows are not comparable");
  if (differ([](const auto& r) { return ranked_rules(r); }))
    all.emplace_back("the agents ran with different rules (key 'rules' of their results)");
  for (const auto& result : results)
    if (!result.partial_of.empty())
      all.push_back(result.agent + " is partial: the first " + std::to_string(result.episodes.size()) + " episodes of its set");
  if (differ([](const auto& r) { return r.episodes.size(); })) all.emplace_back("the agents ran different numbers of episodes");
  for (const auto& result : results)
    if (result.standing && !result.standing->apart.empty())
      all.push_back(result.shown_agent() + " is not ranked: " + result.standing->apart);
  if (differ([](const auto& r) { return r.engine_hash; })) all.emplace_back("the agents ran with different builds of the engine");
  return all;
}

std::vector<EvaluationResult> ranked(std::vector<EvaluationResult> results) {
  const auto is_apart = [](const auto& r) { return r.standing && !r.standing->apart.empty(); };
  const auto track = [&](const auto& r) { return r.standing ? (is_apart(r) ? std::string() : r.standing->track) : std::string(); };
  std::ranges::stable_sort(results, [&](const auto& a, const auto& b) {
    const auto key = [&](const auto& r) { return std::tuple(is_apart(r), track(r), -r.spl().mean, -r.success().mean); };
    return key(a) != key(b) ? key(a) < key(b) : a.agent < b.agent;
  });
  return results;
}

std::vector<int> ranks_of(const std::vector<EvaluationResult>& rows) {
  std::map<std::string, int> in_track;
  std::vector<int> ranks;
  for (const EvaluationResult& row : rows) {
    const bool apart = row.standing && !row.standing->apart.empty();
    ranks.push_back(apart ? 0 : ++in_track[row.standing ? row.standing->track : std::string()]);
  }
  return ranks;
}

std::string leaderboard_text(const std::vector<EvaluationResult>& results) {
  const bool stands = std::ranges::any_of(results, [](const auto& result) { return result.standing.has_value(); });
  std::vector<std::vector<std::string>> table{{"rank", "agent"}};
  if (stands) table[0].emplace_back("track");
  for (const auto& column : board_columns()) table[0].emplace_back(column.title);
  table[0].emplace_back("episodes");
  if (any_verified(results)) table[0].emplace_back("verified");
  if (stands) table[0].emplace_back("rests on");
  const auto rows = ranked(results);
  const std::vector<int> ranks = ranks_of(rows);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::vector<std::string> line{ranks[i] > 0 ? std::to_string(ranks[i]) : "-", rows[i].shown_agent()};
    if (stands) line.push_back(rows[i].standing ? rows[i].standing->track : "");
    for (const auto& column : board_columns()) line.push_back(cell(column.get(rows[i]), column.digits));
    line.push_back(std::to_string(rows[i].episodes.size()));
    if (any_verified(results)) line.emplace_back(rows[i].verified ? "yes" : "no");
    if (stands) line.push_back(rows[i].standing ? rows[i].standing->rests_on : "");
    table.push_back(std::move(line));
  }
  std::vector<std::size_t> widths(table[0].size(), 0);
  for (const auto& line : table)
    for (std::size_t c = 0; c < line.size(); ++c) widths[c] = std::max(widths[c], line[c].size());
  std::string text;
  for (const auto& line : table) {
    for (std::size_t c = 0; c < line.size(); ++c) text += fmt::format("{}{:<{}}", c == 0 ? "" : "  ", line[c], widths[c]);
    while (!text.empty() && text.back() == ' ') text.pop_back();
    text += '\n';
  }
  text += "mean [95 % interval; " + interval_kind(rows) + "]\n";
  for (const auto& note : board_notes(rows)) text += "note: " + note + "\n";
  return text;
}

std::string leaderboard_json(const std::vector<EvaluationResult>& results) {
  using Json = nlohmann::ordered_json;
  const auto rows = ranked(results);
  const std::vector<int> ranks = ranks_of(rows);
  Json agents = Json::array();
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const EvaluationResult& row = rows[i];
    Json metrics;
    for (const auto& [name, estimate] : row.summary())
      metrics[name] = {{"mean", estimate.mean}, {"low", estimate.low}, {"high", estimate.high}};
    agents.push_back({{"rank", ranks[i] > 0 ? Json(ranks[i]) : Json()},
                      {"agent", row.agent},
                      {"baseline", row.baseline},
                      {"policy_hash", row.policy_hash},
                      {"engine_hash", row.engine_hash},
                      {"set_hash", row.set_hash},
                      {"episodes", row.episodes.size()},
                      {"partial", !row.partial_of.empty()},
                      {"verified", row.verified},
                      {"metrics", std::move(metrics)}});
    if (!row.standing) continue;
    agents.back()["track"] = row.standing->track;
    agents.back()["rests_on"] = row.standing->rests_on;
    agents.back()["apart"] = row.standing->apart;
  }
  const Json json{{"schema_version", 1}, {"intervals", interval_kind(rows)}, {"agents", std::move(agents)}, {"notes", board_notes(rows)}};
  return json_text(json, 2) + "\n";
}

}  // namespace earshot
