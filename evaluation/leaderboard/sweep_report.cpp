// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "evaluation/leaderboard/sweep.h"
#include "sim/base/charts/plot_axes.h"
#include "sim/base/charts/svg_document.h"
#include "sim/base/text/json.h"
#include "sim/base/text/markup.h"

namespace earshot {
namespace {

constexpr const char *kSuccess = "episodes/success", *kSpl = "episodes/spl", *kReward = "episodes/reward";
constexpr double kLastFraction = 0.1;  ///< of the steps, over which a run's final numbers are means
constexpr int kGrid = 120;             ///< places along the steps at which seeds are compared

struct Colour {
  const char *line, *band;
};
constexpr Colour kColours[] = {{"#2a6fdb", "#d3e1f8"}, {"#e07b00", "#fbe3c8"}, {"#3a9a55", "#d3ecd9"}, {"#b03a8c", "#f0d3e6"},
                               {"#6b5bd2", "#dedaf6"}, {"#8a6d3b", "#e9e0d1"}, {"#c0392b", "#f6d5d1"}, {"#17818f", "#cfe8eb"}};

std::optional<double> value_of(const CurvePoint& point, const char* key) {
  for (const auto& [name, value] : point.values)
    if (name == key && std::isfinite(value)) return value;
  return std::nullopt;
}

/// Names of variants in the order in which they come.
std::vector<std::string> variants_of(const std::vector<SweepCurve>& curves) {
  std::vector<std::string> names;
  for (const SweepCurve& curve : curves)
    if (std::ranges::find(names, curve.variant) == names.end()) names.push_back(curve.variant);
  return names;
}

/// Mean over the last tenth of the steps; NaN where no episode ended there.
double final_value(const SweepCurve& curve, const char* key) {
  if (curve.points.empty()) return std::numeric_limits<double>::quiet_NaN();
  const double last = static_cast<double>(curve.points.back().env_steps);
  double sum = 0;
  int count = 0;
  for (const CurvePoint& point : curve.points) {
    const auto value = value_of(point, key);
    if (!value || static_cast<double>(point.env_steps) < (1 - kLastFraction) * last) continue;
    sum += *value;
    ++count;
  }
  return count > 0 ? sum / count : std::numeric_limits<double>::quiet_NaN();
}

/// Between the points of a curve; nothing before its first and behind its last.
std::optional<double> value_at(const SweepCurve& curve, const char* key, double steps) {
  std::optional<std::pair<double, double>> before;
  for (const CurvePoint& point : curve.points) {
    const auto value = value_of(point, key);
    if (!value) continue;
    const double at = static_cast<double>(point.env_steps);
    if (at >= steps) {
      if (!before) return at == steps ? value : std::nullopt;
      const auto [from, then] = *before;
      return then + (*value - then) * (steps - from) / (at - from);
    }
    before = {at, *value};
  }
  return std::nullopt;
}

/// Mean, lowest and highest of the seeds of a variant along the steps, where every seed that has points has one.
struct Band {
  std::vector<double> steps, mean, low, high;
};
Band band_of(const std::vector<SweepCurve>& curves, const std::string& variant, const char* key, double most_steps) {
  Band band;
  for (int i = 0; i <= kGrid; ++i) {
    const double steps = most_steps * i / kGrid;
    double sum = 0, low = std::numeric_limits<double>::infinity(), high = -low;
    int count = 0, seeds = 0;
    for (const SweepCurve& curve : curves) {
      if (curve.variant != variant || curve.points.empty()) continue;
      ++seeds;
      const auto value = value_at(curve, key, steps);
      if (!value) continue;
      ++count;
      sum += *value;
      low = std::min(low, *value);
      high = std::max(high, *value);
    }
    if (count == 0 || count < seeds) continue;
    band.steps.push_back(steps);
    band.mean.push_back(sum / count);
    band.low.push_back(low);
    band.high.push_back(high);
  }
  return band;
}

std::string interval(const Estimate& estimate, int digits) {
  if (!std::isfinite(estimate.mean)) return "-";
  return fmt::format("{:.{}f} [{:.{}f}, {:.{}f}]", estimate.mean, digits, estimate.low, digits, estimate.high, digits);
}

bool any_evaluated(const std::vector<SweepRow>& rows) {
  return std::ranges::any_of(rows, [](const SweepRow& row) { return row.evaluated > 0; });
}

nlohmann::ordered_json json_of(const std::optional<double>& value) { return value ? nlohmann::ordered_json(*value) : nullptr; }

nlohmann::ordered_json json_of(const Estimate& estimate) {
  if (!std::isfinite(estimate.mean)) return nullptr;
  return {{"mean", estimate.mean}, {"low", estimate.low}, {"high", estimate.high}};
}

}  // namespace

std::vector<SweepRow> sweep_rows(const std::vector<SweepCurve>& curves) {
  std::vector<SweepRow> rows;
  for (const std::string& variant : variants_of(curves)) {
    SweepRow row;
    row.variant = variant;
    std::vector<double> success, spl, reward, held_out_success, held_out_spl;
    for (const SweepCurve& curve : curves) {
      if (curve.variant != variant) continue;
      ++row.seeds;
      if (!curve.finished) continue;
      ++row.finished;
      for (const auto& [values, key] : {std::pair(&success, kSuccess), std::pair(&spl, kSpl), std::pair(&reward, kReward)})
        if (const double value = final_value(curve, key); std::isfinite(value)) values->push_back(value);
      if (curve.held_out_success && curve.held_out_spl) {
        held_out_success.push_back(*curve.held_out_success);
        held_out_spl.push_back(*curve.held_out_spl);
      }
      if (curve.points.empty()) continue;
      row.env_steps += static_cast<double>(curve.points.back().env_steps);
      row.minutes += curve.points.back().wall_s / 60;
    }
    const auto estimate = [](const std::vector<double>& values) {
      constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();
      return values.empty() ? Estimate{not_a_number, not_a_number, not_a_number} : mean_with_interval(values);
    };
    row.success = estimate(success);
    row.spl = estimate(spl);
    row.reward = estimate(reward);
    row.evaluated = held_out_success.size();
    row.held_out_success = estimate(held_out_success);
    row.held_out_spl = estimate(held_out_spl);
    const double finished = static_cast<double>(std::max<std::size_t>(1, row.finished));
    row.env_steps /= finished;
    row.minutes /= finished;
    rows.push_back(std::move(row));
  }
  return rows;
}

std::string sweep_text(const std::vector<SweepRow>& rows) {
  const bool evaluated = any_evaluated(rows);
  std::vector<std::vector<std::string>> table{{"run", "seeds", "success", "SPL", "reward", "steps", "minutes"}};
  if (evaluated) table[0].insert(table[0].end(), {"held-out success", "held-out SPL"});
  for (const SweepRow& row : rows) {
    table.push_back({row.variant, fmt::format("{}/{}", row.finished, row.seeds), interval(row.success, 3), interval(row.spl, 3),
                     interval(row.reward, 2), fmt::format("{:.0f}", row.env_steps), fmt::format("{:.1f}", row.minutes)});
    if (evaluated) table.back().insert(table.back().end(), {interval(row.held_out_success, 3), interval(row.held_out_spl, 3)});
  }
  std::vector<std::size_t> widths(table[0].size(), 0);
  for (const auto& line : table)
    for (std::size_t c = 0; c < line.size(); ++c) widths[c] = std::max(widths[c], line[c].size());
  std::string text;
  for (const auto& line : table) {
    for (std::size_t c = 0; c < line.size(); ++c) text += fmt::format("{}{:<{}}", c == 0 ? "" : "  ", line[c], widths[c]);
    while (text.back() == ' ') text.pop_back();
    text += '\n';
  }
  return text + "training episodes of the last tenth of the steps" + (evaluated ? ", held-out: the episodes of data.eval" : "") +
         "; mean [95 % interval over seeds, Student's t]\n";
}

std::string sweep_json(const SweepConfig& sweep, const std::vector<SweepCurve>& curves) {
  using Json = nlohmann::ordered_json;
  Json runs = Json::array();
  for (const SweepRow& row : sweep_rows(curves)) {
    Json seeds = Json::array();
    for (const SweepCurve& curve : curves) {
      if (curve.variant != row.variant) continue;
      const auto number = [&](const char* key) {
        const double value = final_value(curve, key);
        return std::isfinite(value) ? Json(value) : Json();
      };
      seeds.push_back({{"seed", curve.seed},
                       {"finished", curve.finished},
                       {"env_steps", curve.points.empty() ? 0 : curve.points.back().env_steps},
                       {"wall_s", curve.points.empty() ? 0.0 : curve.points.back().wall_s},
                       {"success", number(kSuccess)},
                       {"spl", number(kSpl)},
                       {"reward", number(kReward)},
                       {"held_out_success", json_of(curve.held_out_success)},
                       {"held_out_spl", json_of(curve.held_out_spl)}});
    }
    runs.push_back({{"run", row.variant},
                    {"success", json_of(row.success)},
                    {"spl", json_of(row.spl)},
                    {"reward", json_of(row.reward)},
                    {"held_out_success", json_of(row.held_out_success)},
                    {"held_out_spl", json_of(row.held_out_spl)},
                    {"seeds", std::move(seeds)}});
  }
  return json_text(Json{{"schema_version", 1}, {"sweep", sweep.name}, {"config", sweep.config}, {"runs", std::move(runs)}}, 2) + "\n";
}

std::string sweep_svg(const SweepConfig& sweep, const std::vector<SweepCurve>& curves) {
  double most_steps = 1, low = 0, high = 1;
  for (const SweepCurve& curve : curves)
    for (const CurvePoint& point : curve.points) {
      most_steps = std::max(most_steps, static_cast<double>(point.env_steps));
      if (const auto reward = value_of(point, kReward)) {
        low = std::min(low, std::floor(*reward));
        high = std::max(high, std::ceil(*reward));
      }
    }
  const auto variants = variants_of(curves);
  const PlotScale steps{.low = 0, .high = most_steps};
  struct Panel {
    const char *key, *label;
    PlotScale scale;
  };
  const Panel panels[] = {
      {kSuccess, "success", {.low = 0, .high = 1}}, {kSpl, "SPL", {.low = 0, .high = 1}}, {kReward, "reward", {.low = low, .high = high}}};
  SvgDocument svg;
  svg.text({70, 24}, sweep.name, {.size_px = 16});
  double top = 46;
  for (const Panel& panel : panels) {
    const PlotAxes axes{.left = 70, .top = top, .width = 620, .height = 170, .x_scale = steps, .y_scale = panel.scale};
    axes.draw(svg, plot_ticks(steps, 1e-3), plot_ticks(panel.scale));
    axes.draw_captions(svg, "", panel.key == kReward ? "thousand environment steps" : "", panel.label);
    for (const bool lines : {false, true})  // lines lie over all bands
      for (std::size_t i = 0; i < variants.size(); ++i) {
        const Band band = band_of(curves, variants[i], panel.key, most_steps);
        const Colour& colour = kColours[i % std::size(kColours)];
        std::vector<SvgPoint> points;
        if (lines) {
          for (std::size_t k = 0; k < band.steps.size(); ++k) points.push_back(axes.at(band.steps[k], band.mean[k]));
          svg.polyline(points, {.stroke = colour.line, .stroke_width = 2});
        } else {
          for (std::size_t k = 0; k < band.steps.size(); ++k) points.push_back(axes.at(band.steps[k], band.high[k]));
          for (std::size_t k = band.steps.size(); k-- > 0;) points.push_back(axes.at(band.steps[k], band.low[k]));
          if (points.size() > 2) svg.polygon(points, {.fill = colour.band});
        }
      }
    top += 215;
  }
  for (std::size_t i = 0; i < variants.size(); ++i)
    svg.text({710, 60 + 18 * static_cast<double>(i)}, variants[i], {.colour = kColours[i % std::size(kColours)].line});
  svg.text({70, top + 4}, "line: mean of the seeds; band: lowest to highest", {.size_px = 11});
  return svg.str(900, top + 18);
}

std::string sweep_html(const SweepConfig& sweep, const std::vector<SweepCurve>& curves) {
  std::string html = fmt::format(
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title>\n<style>body{{font:15px/1.4 "
      "system-ui,sans-serif;margin:2rem;color:#222}}table{{border-collapse:collapse}}th,td{{padding:.4rem "
      ".8rem;text-align:left;border-bottom:1px solid "
      "#ddd;font-variant-numeric:tabular-nums}}svg{{max-width:100%;height:auto}}</style></head><body>\n<h1>Sweep {0}</h1>\n<p>{1}, seeds",
      escape_markup(sweep.name), escape_markup(sweep.config));
  for (const std::uint64_t seed : sweep.seeds) html += fmt::format(" {}", seed);
  html +=
      "</p>\n<table><thead><tr><th>run</th><th>changes</th><th>seeds</th><th>success</th><th>SPL</th><th>reward</th><th>steps</"
      "th><th>minutes</th>";
  const auto rows = sweep_rows(curves);
  const bool evaluated = any_evaluated(rows);
  if (evaluated) html += "<th>held-out success</th><th>held-out SPL</th>";
  html += "</tr></thead><tbody>\n";
  for (const SweepRow& row : rows) {
    std::string changes;
    for (const auto& variant : sweep.runs)
      if (variant.name == row.variant)
        for (const std::string& override : variant.overrides) changes += (changes.empty() ? "" : " ") + override;
    html +=
        fmt::format("<tr><td>{}</td><td><code>{}</code></td><td>{}/{}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.0f}</td><td>{:.1f}</td>",
                    escape_markup(row.variant), escape_markup(changes), row.finished, row.seeds, interval(row.success, 3),
                    interval(row.spl, 3), interval(row.reward, 2), row.env_steps, row.minutes);
    if (evaluated) html += fmt::format("<td>{}</td><td>{}</td>", interval(row.held_out_success, 3), interval(row.held_out_spl, 3));
    html += "</tr>\n";
  }
  html += "</tbody></table>\n<p>Training episodes of the last tenth of the steps; mean and 95 % interval over seeds (Student's t).</p>\n";
  std::string svg = sweep_svg(sweep, curves);
  if (const std::size_t start = svg.find("<svg"); start != std::string::npos) svg.erase(0, start);  // HTML has no XML declaration
  return html + svg + "</body></html>\n";
}

}  // namespace earshot
