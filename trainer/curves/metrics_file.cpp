// SPDX-License-Identifier: Apache-2.0
#include "trainer/curves/metrics_file.h"

#include <fmt/format.h>

#include <cmath>
#include <string_view>
#include <vector>

#include "sim/base/files.h"

namespace earshot {
namespace {

struct Sample {
  std::string worker;  ///< empty: of all
  double value = 0;
};

struct Family {
  std::string name, source;
  bool counter = false;
  std::vector<Sample> samples;
};

/// Letters, digits and underscores; units in full.
std::string metric_name(std::string_view curve, bool counter) {
  std::string name = "earshot_";
  for (const char c : curve) name += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
  const auto replace_end = [&](std::string_view end, std::string_view unit) {
    if (name.ends_with(end)) name.replace(name.size() - end.size(), end.size(), unit);
  };
  if (name.ends_with("_per_s"))
    replace_end("_per_s", "_per_second");
  else
    replace_end("_s", "_seconds");
  replace_end("_m", "_meters");
  return counter ? name + "_total" : name;
}

/// Backslash, quote and line end have escapes in label values.
std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '\\' || c == '"') result += '\\';
    if (c == '\n')
      result += "\\n";
    else
      result += c;
  }
  return result;
}

/// "3" and "workers/update_s" of "workers/3/update_s".
std::pair<std::string, std::string> worker_of(const std::string& curve) {
  constexpr std::string_view prefix = "workers/";
  const std::size_t slash = curve.find('/', prefix.size());
  if (!curve.starts_with(prefix) || slash == std::string::npos) return {{}, curve};
  return {curve.substr(prefix.size(), slash - prefix.size()), std::string(prefix) + curve.substr(slash + 1)};
}

bool is_total(std::string_view curve) { return curve.starts_with("guards/") || curve.starts_with("fields/"); }

}  // namespace

std::string prometheus_text(const CurvePoint& point, const std::string& run) {
  std::vector<Family> families;
  const auto add = [&](const std::string& curve, double value, bool counter) {
    if (std::isnan(value)) return;
    const auto [worker, source] = worker_of(curve);
    const std::string name = metric_name(source, counter);
    auto family = families.begin();
    while (family != families.end() && family->name != name) ++family;
    if (family == families.end()) family = families.insert(family, {name, source, counter, {}});
    family->samples.push_back({worker, value});
  };
  add("update", static_cast<double>(point.update), true);
  add("env_steps", static_cast<double>(point.env_steps), true);
  add("training_s", point.wall_s, false);
  for (const auto& [curve, value] : point.values) add(curve, value, is_total(curve));

  std::string text;
  for (const Family& family : families) {
    text += fmt::format("# HELP {} Curve {} of the last update (docs/howto/training.md).\n# TYPE {} {}\n", family.name, family.source,
                        family.name, family.counter ? "counter" : "gauge");
    for (const Sample& sample : family.samples) {
      const std::string worker = sample.worker.empty() ? std::string() : fmt::format(",worker=\"{}\"", sample.worker);
      const std::string value = std::isinf(sample.value) ? (sample.value > 0 ? "+Inf" : "-Inf") : fmt::format("{}", sample.value);
      text += fmt::format("{}{{run=\"{}\"{}}} {}\n", family.name, escaped(run), worker, value);
    }
  }
  return text;
}

void write_metrics_file(const std::filesystem::path& file, const CurvePoint& point, const std::string& run) {
  write_file_atomically(file, prometheus_text(point, run));
}

}  // namespace earshot
