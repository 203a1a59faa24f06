// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/measure/measured.h"

namespace earshot {

using BenchJson = nlohmann::ordered_json;

/// What `earshot bench --json` writes: {"bench", "machine", "commit", "results": [{"name", "unit", "value", "min", "max", "setting"}]},
/// value being the median.  A value that is not finite is written as null.
class BenchReport {
 public:
  explicit BenchReport(std::string bench) : bench_(std::move(bench)) {}
  void add(std::string name, std::string unit, Measured measured, BenchJson setting);
  [[nodiscard]] BenchJson json() const;
  /// One line per result: name, median, range, unit and where.
  [[nodiscard]] std::string table() const;
  /// To the file if `path` is not empty.
  void write(const std::string& path) const;

 private:
  struct Result {
    std::string name, unit;
    Measured measured;
    BenchJson setting;
  };
  std::string bench_;
  std::vector<Result> results_;
};

/// Processor, cores, load at that time, compiler and build type, without which a number cannot be compared.
BenchJson machine_json();

}  // namespace earshot
