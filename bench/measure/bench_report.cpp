// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/bench_report.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <thread>

#include "sim/base/engine_commit.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

BenchJson number(double value) { return std::isfinite(value) ? BenchJson(value) : BenchJson(nullptr); }

std::string cpu_model() {
  std::ifstream stream("/proc/cpuinfo");
  for (std::string line; std::getline(stream, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown";
}

}  // namespace

void BenchReport::add(std::string name, std::string unit, Measured measured, BenchJson setting) {
  results_.push_back({std::move(name), std::move(unit), measured, std::move(setting)});
}

BenchJson BenchReport::json() const {
  BenchJson results = BenchJson::array();
  for (const Result& result : results_) {
    results.push_back({{"name", result.name},
                       {"unit", result.unit},
                       {"value", number(result.measured.value)},
                       {"min", number(result.measured.min)},
                       {"max", number(result.measured.max)},
                       {"setting", result.setting}});
  }
  return {
      {"schema_version", 1}, {"bench", bench_}, {"machine", machine_json()}, {"commit", engine_commit()}, {"results", std::move(results)}};
}

std::string BenchReport::table() const {
  std::string text;
  for (const Result& result : results_) {
    const std::string scene = result.setting.contains("scene") ? result.setting["scene"].get<std::string>() : "";
    text += fmt::format("{:<34} {:>10.4g} {:<8} [{:.4g} .. {:.4g}]  {}\n", result.name, result.measured.value, result.unit,
                        result.measured.min, result.measured.max, scene);
  }
  return text;
}

void BenchReport::write(const std::string& path) const {
  if (!path.empty()) write_file_atomically(path, json_text(json(), 1) + "\n");
}

BenchJson machine_json() {
  double load[1] = {0};
  const bool has_load = getloadavg(load, 1) == 1;
  return {{"cpu", cpu_model()},
          {"cores", std::thread::hardware_concurrency()},
          {"load_1min", has_load ? BenchJson(load[0]) : BenchJson(nullptr)},
          {"compiler", __VERSION__},
          {"build", build_type()}};
}

}  // namespace earshot
