// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "evaluation/results/result.h"

namespace earshot {

/// The whole of results that each have the rows of their EvaluationPart: the bytes of one process.  files: all parts, in their order.
/// what: of the command, for messages.  Throws InputError where a file cannot be read, RunError where the parts differ in anything but
/// their rows, or an episode is in none.
EvaluationResult join_evaluation_parts(const std::vector<std::filesystem::path>& files, const std::string& what);

/// Parts of one evaluation that processes on any machines leave in one folder (`earshot eval --shard K/N --parts FOLDER`).  A part is
/// written whole or not at all.
///
///     EvaluationParts parts("parts", 4, settings);
///     if (!parts.has(2)) parts.save(2, evaluate(...));
///     if (parts.missing() == 0) save_result(parts.join(), "result.json");
class EvaluationParts {
 public:
  /// Makes the folder where it is missing.  count: of the parts.  settings: all that the result depends on, as lines.  Throws InputError
  /// where the folder has parts of other settings.
  EvaluationParts(std::filesystem::path folder, int count, const std::string& settings);
  /// part: from 0 to count - 1.
  [[nodiscard]] bool has(int part) const;
  void save(int part, const EvaluationResult& result) const;
  [[nodiscard]] int missing() const;
  /// join_evaluation_parts() of the folder.  None must be missing.
  [[nodiscard]] EvaluationResult join() const;

 private:
  [[nodiscard]] std::filesystem::path file(int part) const;

  std::filesystem::path folder_;
  int count_;
};

}  // namespace earshot
