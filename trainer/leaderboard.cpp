#include "trainer/leaderboard.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>

namespace earshot {
namespace {

struct Column {
  const char* title;
  std::function<Estimate(const EvaluationResult&)> get;
  int digits;
  double bar_scale;  ///< 0: no bar
};

const std::vector<Column>& columns() {
  static const std::vector<Column> all{{"success", [](const EvaluationResult& r) { return r.success(); }, 3, 1.0},
                                       {"SPL", [](const EvaluationResult& r) { return r.spl(); }, 3, 1.0},
                                       {"SoftSPL", [](const EvaluationResult& r) { return r.soft_spl(); }, 3, 0},
                                       {"SNA", [](const EvaluationResult& r) { return r.sna(); }, 3, 0},
                                       {"DTG m", [](const EvaluationResult& r) { return r.dtg_m(); }, 2, 0},
                                       {"steps", [](const EvaluationResult& r) { return r.steps(); }, 0, 0},
                                       {"collisions", [](const EvaluationResult& r) { return r.collisions(); }, 1, 0}};
  return all;
}

std::string cell(const Estimate& estimate, int digits) {
  return fmt::format("{:.{}f} [{:.{}f}, {:.{}f}]", estimate.mean, digits, estimate.low, digits, estimate.high, digits);
}

std::string interval_kind(const std::vector<EvaluationResult>& results) {
  const bool over_scenes = std::ranges::all_of(results, [](const auto& result) { return result.intervals_over_scenes(); });
  return over_scenes ? "bootstrap over scenes" : "over episodes: Wilson for success, else Student's t";
}

/// Of the rules those that ranked numbers depend on.
std::map<std::string, std::string> ranked_rules(const EvaluationResult& result) {
  std::map<std::string, std::string> rules = result.rules;
  std::erase_if(rules, [](const auto& rule) {
    return rule.first.ends_with("_reward") || !(rule.first.starts_with("task.") || rule.first.starts_with("navmesh."));
  });
  return rules;
}

bool any_verified(const std::vector<EvaluationResult>& results) { return std::ranges::any_of(results, &EvaluationResult::verified); }

/// What makes the rows hard to compare, or empty.
std::vector<std::string> notes(const std::vector<EvaluationResult>& results) {
  std::vector<std::string> all;
  const auto differ = [&](auto get) { return std::ranges::any_of(results, [&](const auto& r) { return get(r) != get(results.front()); }); };
  if (differ([](const auto& r) { return r.set_hash; }))
    all.emplace_back("the agents ran different episode sets: the rows cannot be compared");
  if (differ([](const auto& r) { return ranked_rules(r); }))
    all.emplace_back("the agents ran by different rules (the key 'rules' of their results)");
  for (const auto& result : results)
    if (!result.partial_of.empty())
      all.push_back(result.agent + " is partial: the first " + std::to_string(result.episodes.size()) + " episodes of its set");
  if (differ([](const auto& r) { return r.episodes.size(); })) all.emplace_back("the agents ran different numbers of episodes");
  if (differ([](const auto& r) { return r.engine_hash; })) all.emplace_back("the agents ran in different builds of the engine");
  return all;
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '"')
      out += "&quot;";
    else
      out += c;
  }
  return out;
}

}  // namespace

std::vector<EvaluationResult> ranked(std::vector<EvaluationResult> results) {
  std::ranges::stable_sort(results, [](const auto& a, const auto& b) {
    const auto key = [](const auto& r) { return std::tuple(-r.spl().mean, -r.success().mean); };
    return key(a) != key(b) ? key(a) < key(b) : a.agent < b.agent;
  });
  return results;
}

std::string leaderboard_text(const std::vector<EvaluationResult>& results) {
  std::vector<std::vector<std::string>> table{{"rank", "agent"}};
  for (const auto& column : columns()) table[0].emplace_back(column.title);
  table[0].emplace_back("episodes");
  if (any_verified(results)) table[0].emplace_back("verified");
  const auto rows = ranked(results);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::vector<std::string> line{std::to_string(i + 1), rows[i].agent};
    for (const auto& column : columns()) line.push_back(cell(column.get(rows[i]), column.digits));
    line.push_back(std::to_string(rows[i].episodes.size()));
    if (any_verified(results)) line.emplace_back(rows[i].verified ? "yes" : "no");
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
  for (const auto& note : notes(rows)) text += "note: " + note + "\n";
  return text;
}

std::string leaderboard_json(const std::vector<EvaluationResult>& results) {
  using Json = nlohmann::ordered_json;
  const auto rows = ranked(results);
  Json agents = Json::array();
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const EvaluationResult& row = rows[i];
    Json metrics;
    for (const auto& [name, estimate] : row.summary())
      metrics[name] = {{"mean", estimate.mean}, {"low", estimate.low}, {"high", estimate.high}};
    agents.push_back({{"rank", i + 1},
                      {"agent", row.agent},
                      {"policy_hash", row.policy_hash},
                      {"engine_hash", row.engine_hash},
                      {"set_hash", row.set_hash},
                      {"episodes", row.episodes.size()},
                      {"partial", !row.partial_of.empty()},
                      {"verified", row.verified},
                      {"metrics", std::move(metrics)}});
  }
  const Json json{{"schema_version", 1}, {"intervals", interval_kind(rows)}, {"agents", std::move(agents)}, {"notes", notes(rows)}};
  return json.dump(2) + "\n";
}

std::string leaderboard_html(const std::vector<EvaluationResult>& results, const std::vector<std::pair<std::string, std::string>>& links) {
  std::string html =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Earshot leaderboard</title>\n<style>\n"
      "body{font:15px/1.4 system-ui,sans-serif;margin:2rem;color:#222}table{border-collapse:collapse}\n"
      "th,td{padding:.4rem .8rem;text-align:left;border-bottom:1px solid #ddd;font-variant-numeric:tabular-nums}\n"
      ".bar{position:relative;width:9rem;height:.7rem;background:#eee}.bar i{position:absolute;top:0;bottom:0;left:0;background:#3b7dd8}\n"
      ".bar b{position:absolute;top:.25rem;height:.2rem;background:#123}small{color:#666}\n</style></head><body>\n<h1>Earshot "
      "leaderboard</h1>\n<table><thead><tr><th>rank</th><th>agent</th>";
  for (const auto& column : columns()) html += fmt::format("<th>{}</th>", column.title);
  html += any_verified(results) ? "<th>episodes</th><th>verified</th>" : "<th>episodes</th>";
  html += "</tr></thead><tbody>\n";
  const auto rows = ranked(results);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    html += fmt::format("<tr><td>{}</td><td>{}</td>", i + 1, escaped(rows[i].agent));
    for (const auto& column : columns()) {
      const Estimate e = column.get(rows[i]);
      html +=
          fmt::format("<td>{:.{}f} <small>[{:.{}f}, {:.{}f}]</small>", e.mean, column.digits, e.low, column.digits, e.high, column.digits);
      if (column.bar_scale > 0)
        html += fmt::format("<div class=\"bar\"><i style=\"width:{:.1f}%\"></i><b style=\"left:{:.1f}%;width:{:.1f}%\"></b></div>",
                            100 * e.mean / column.bar_scale, 100 * e.low / column.bar_scale, 100 * (e.high - e.low) / column.bar_scale);
      html += "</td>";
    }
    html += fmt::format("<td>{}</td>", rows[i].episodes.size());
    if (any_verified(results)) html += rows[i].verified ? "<td>yes</td>" : "<td>no</td>";
    html += "</tr>\n";
  }
  html += "</tbody></table>\n<p>Mean and 95 % interval (" + interval_kind(rows) + "). Bars: mean, dark line: interval.</p>\n";
  for (const auto& note : notes(rows)) html += "<p><strong>Note:</strong> " + escaped(note) + "</p>\n";
  if (!links.empty()) {
    html += "<ul>\n";
    for (const auto& [address, text] : links) html += fmt::format("<li><a href=\"{}\">{}</a></li>\n", escaped(address), escaped(text));
    html += "</ul>\n";
  }
  if (!rows.empty())
    html += fmt::format("<p><small>Episodes: {}, set {}. Engine {}.</small></p>\n", escaped(rows.front().episodes_file),
                        rows.front().set_hash, rows.front().engine_hash);
  return html + "</body></html>\n";
}

}  // namespace earshot
