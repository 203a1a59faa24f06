// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/leaderboard_page.h"

#include <fmt/format.h>

#include <algorithm>

#include "evaluation/leaderboard/leaderboard.h"
#include "evaluation/results/result_groups.h"
#include "sim/base/text/markup.h"

namespace earshot {
namespace {

constexpr const char* kStyle =
    R"(:root { color-scheme: light dark; --page: #fff; --text: #1b2330; --quiet: #566274; --line: #d5dbe4; --bar: #3b7dd8; --link: #1f5fbf; --track: #e8ecf2; --tick: #10203a; --flag: #b3261e; }
@media (prefers-color-scheme: dark) {
  :root { --page: #0e1117; --text: #e8ecf3; --quiet: #9aa7ba; --line: #2a3242; --bar: #4f8fe6; --link: #82b4f8; --track: #1d2430; --tick: #f2f6ff; --flag: #ff8a80; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 100rem; padding: 1rem 1.5rem 2rem; background: var(--page); color: var(--text); font: 15px/1.45 system-ui, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.5rem; margin: .3rem 0; }
h2 { font-size: 1.15rem; margin: 1.8rem 0 .4rem; }
a { color: var(--link); }
:focus-visible { outline: 2px solid var(--bar); outline-offset: 2px; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: .5rem 0 1rem; }
caption { text-align: left; color: var(--quiet); padding-bottom: .3rem; }
th, td { padding: .35rem .8rem .35rem 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line); font-variant-numeric: tabular-nums; white-space: nowrap; }
td.words { white-space: normal; min-width: 13rem; }
thead th { vertical-align: bottom; }
tbody th { font-weight: 600; }
small, .quiet { color: var(--quiet); }
.bar { display: block; position: relative; width: 8.5rem; height: .6rem; margin-top: .15rem; background: var(--track); }
.bar i { position: absolute; inset: 0 auto 0 0; background: var(--bar); }
.bar b { position: absolute; top: .2rem; height: .2rem; background: var(--tick); }
.flag { color: var(--flag); font-weight: 600; }
summary { cursor: pointer; font-size: 1.15rem; font-weight: 600; margin: 1.8rem 0 .4rem; }
)";

std::string numbers(const Estimate& e, int digits) {
  return fmt::format("{:.{}f} <small>[{:.{}f}, {:.{}f}]</small>", e.mean, digits, e.low, digits, e.high, digits);
}

/// Of a number from 0 to 1; says nothing that the numbers before it do not.
std::string bar(const Estimate& e) {
  return fmt::format(
      R"(<span class="bar" aria-hidden="true"><i style="width:{:.1f}%"></i><b style="left:{:.1f}%;width:{:.1f}%"></b></span>)",
      100 * e.mean, 100 * e.low, 100 * (e.high - e.low));
}

std::string links(const std::vector<std::pair<std::string, std::string>>& all) {
  std::string html;
  for (const auto& [address, text] : all)
    html += fmt::format("{}<a href=\"{}\">{}</a>", html.empty() ? "" : ", ", escape_markup(address), escape_markup(text));
  return html;
}

/// A table that scrolls by itself where the window is too narrow, by the keyboard too.
std::string table(const std::string& caption, const std::vector<std::string>& heads, const std::string& rows) {
  std::string html = fmt::format(
      "<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"{0}\"><table>\n<caption>{0}</caption>\n<thead><tr>", caption);
  for (const std::string& head : heads) html += fmt::format("<th scope=\"col\">{}</th>", head);
  return html + "</tr></thead>\n<tbody>\n" + rows + "</tbody></table></div>\n";
}

/// Whom the agent is compared with, and what shows that it chose its actions by what it sensed.
std::string standing_cells(const EvaluationResult& row) {
  if (!row.standing) return "<td>unknown</td><td>unknown</td>";
  return fmt::format("<td>{}</td><td class=\"words\">{}</td>", escape_markup(row.standing->track), escape_markup(row.standing->rests_on));
}

std::string main_table(const std::vector<EvaluationResult>& rows, const BoardPage& page) {
  const bool verified = any_verified(rows);
  const bool silence = std::ranges::any_of(rows, [](const auto& row) { return row.success_when_silent().mean > 0; });
  // The ranking metric, its source and its plot come first: in narrow windows the rest has to be scrolled to.
  constexpr std::size_t kRankedBy = 2;  // success and SPL
  const std::vector<BoardColumn>& columns = board_columns();
  std::vector<std::string> heads{"rank", "agent"};
  for (std::size_t c = 0; c < kRankedBy; ++c) heads.emplace_back(columns[c].title);
  const bool stands = std::ranges::any_of(rows, [](const auto& row) { return row.standing.has_value(); });
  const std::vector<int> ranks = ranks_of(rows);
  if (stands) heads.insert(heads.end(), {"track", "origin of the actions"});
  if (!page.replays.empty()) heads.emplace_back("replays");
  for (std::size_t c = kRankedBy; c < columns.size(); ++c) heads.emplace_back(columns[c].title);
  if (silence) heads.emplace_back("success when silent");
  heads.emplace_back("episodes");
  if (verified) heads.emplace_back("verified");
  std::string body;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const EvaluationResult& row = rows[i];
    const std::string rank = ranks[i] > 0 ? std::to_string(ranks[i]) : "not ranked";
    body += fmt::format("<tr><td>{}</td><th scope=\"row\">{}</th>", rank, escape_markup(row.shown_agent()));
    const auto cell = [&](std::size_t c) {
      const Estimate e = columns[c].get(row);
      body += "<td>" + numbers(e, columns[c].digits) + (c < kRankedBy ? bar(e) : "") + "</td>";
    };
    for (std::size_t c = 0; c < kRankedBy; ++c) cell(c);
    if (stands) body += standing_cells(row);
    if (!page.replays.empty()) {
      const auto found = page.replays.find(row.agent);
      body += "<td class=\"words\">" + (found == page.replays.end() ? std::string("none") : links(found->second)) + "</td>";
    }
    for (std::size_t c = kRankedBy; c < columns.size(); ++c) cell(c);
    if (silence) body += "<td>" + numbers(row.success_when_silent(), 3) + "</td>";
    body += fmt::format("<td>{}</td>", row.episodes.size());
    if (verified) body += row.verified ? "<td>yes</td>" : "<td>no</td>";
    body += "</tr>\n";
  }
  return table(std::string(stands ? "Agents of each track by SPL" : "Agents by SPL") + ": mean and 95 % interval (" + interval_kind(rows) +
                   "); bars: mean, with the interval across",
               heads, body);
}

std::string private_table(const BoardPage& page) {
  std::string body;
  for (const PrivateScore& score : page.private_scores) {
    const auto line = [&](const char* metric, const Estimate& open, const Estimate& hidden, const Estimate& gap) {
      body += fmt::format(
          "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}{}</td><td>{}{}</td><td>{:+.3f} <small>[{:+.3f}, {:+.3f}]</small></td>"
          "<td class=\"words\">{}</td></tr>\n",
          escape_markup(score.agent), metric, numbers(open, 3), bar(open), numbers(hidden, 3), bar(hidden), gap.mean, gap.low, gap.high,
          gap.low > 0 ? "<span class=\"flag\">better in public than chance explains</span>" : "within chance");
    };
    line("success", score.public_success, score.private_success, score.success_gap);
    line("SPL", score.public_spl, score.private_spl, score.spl_gap);
  }
  return "<h2>Public and private set</h2>\n"
         "<p>The benchmark contains only the SHA-256 of the private set, so no policy can have been trained on it.</p>\n" +
         table("Public and private set: mean and 95 % interval, and their difference",
               {"agent", "metric", "public set", "private set", "public minus private", "the gap is"}, body);
}

struct Breakdown {
  GroupBy by;
  const char* name;   ///< of a group
  const char* title;  ///< of the section
};
constexpr Breakdown kBreakdowns[] = {{GroupBy::novelty, "sound", "By novelty of the sound"},
                                     {GroupBy::kind, "kind of sound", "By kind of sound"},
                                     {GroupBy::size, "floor area of the scene", "By size of the scene"},
                                     {GroupBy::distance, "distance", "By geodesic distance from start to goal"},
                                     {GroupBy::scene, "scene", "By scene"}};

/// Success and SPL of every agent by group; nothing where a result does not say, or all episodes are of one group.
std::string breakdown(const std::vector<EvaluationResult>& rows, const Breakdown& grouping) {
  if (!std::ranges::all_of(rows, [&](const auto& row) { return can_group(row, grouping.by); })) return {};
  std::vector<std::vector<std::pair<std::string, EvaluationResult>>> of_agents;
  std::vector<std::string> names;
  for (const EvaluationResult& row : rows) {
    of_agents.push_back(groups_of(row, grouping.by));
    for (const auto& [name, group] : of_agents.back())
      if (std::ranges::find(names, name) == names.end()) names.push_back(name);
  }
  if (names.size() < 2) return {};
  std::vector<std::string> heads{grouping.name, "episodes"};
  for (const EvaluationResult& row : rows) heads.push_back(escape_markup(row.agent));
  const auto metric_table = [&](const std::string& metric, auto get) {
    std::string body;
    for (const std::string& name : names) {
      std::string cells;
      std::size_t episodes = 0;
      for (const auto& groups : of_agents) {
        const auto found = std::ranges::find(groups, name, [](const auto& group) { return group.first; });
        if (found == groups.end()) {
          cells += "<td>none</td>";
          continue;
        }
        episodes = std::max(episodes, found->second.episodes.size());
        const Estimate e = get(found->second);
        cells += "<td>" + numbers(e, 3) + bar(e) + "</td>";
      }
      body += fmt::format("<tr><th scope=\"row\">{}</th><td>{}</td>{}</tr>\n", escape_markup(name), episodes, cells);
    }
    return table(fmt::format("{}, {}: mean and 95 % interval", grouping.title, metric), heads, body);
  };
  const std::string tables = metric_table("success", [](const EvaluationResult& group) { return group.success(); }) +
                             metric_table("SPL", [](const EvaluationResult& group) { return group.spl(); });
  const bool is_long = names.size() > 12;
  return is_long ? fmt::format("<details><summary>{}: {} of them</summary>\n{}</details>\n", grouping.title, names.size(), tables)
                 : fmt::format("<h2>{}</h2>\n{}", grouping.title, tables);
}

}  // namespace

std::string leaderboard_page(const std::vector<EvaluationResult>& results, const BoardPage& page) {
  const auto rows = ranked(results);
  const std::string title = "Earshot leaderboard" + (page.benchmark.empty() ? "" : ": " + escape_markup(page.benchmark));
  std::string html = fmt::format(
      "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, "
      "initial-scale=1\">\n"
      "<title>{0}</title>\n<style>\n{1}</style>\n</head>\n<body>\n<header>\n<h1>{0}</h1>\n",
      title, kStyle);
  if (!rows.empty())
    html += fmt::format("<p class=\"quiet\">Set {}, engine {}.{}</p>\n", escape_markup(rows.front().set_hash),
                        escape_markup(rows.front().engine_hash),
                        any_verified(rows) ? " All numbers of a verified row follow from its recorded actions, which were run again." : "");
  if (!page.links.empty()) html += "<nav aria-label=\"Other pages\">" + links(page.links) + "</nav>\n";
  html += "</header>\n<main>\n" + main_table(rows, page);
  for (const std::string& note : board_notes(rows)) html += "<p><strong>Note:</strong> " + escape_markup(note) + "</p>\n";
  if (!page.private_scores.empty()) html += private_table(page);
  for (const Breakdown& grouping : kBreakdowns) html += breakdown(rows, grouping);
  return html + "</main>\n</body>\n</html>\n";
}

}  // namespace earshot
