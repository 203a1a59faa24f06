// SPDX-License-Identifier: Apache-2.0
#include "sim/base/errors.h"

#include <cstdio>
#include <cstdlib>

#include "sim/base/control_characters.h"

namespace earshot {
namespace {

constexpr std::size_t kLongestMessage = 4000;

/// One line, whatever names and values from files are in it: no line ends and no control characters.
std::string joined(std::string_view where, std::string_view problem, std::string_view remedy) {
  std::string text{where};
  text.append(": ").append(problem);
  if (!remedy.empty()) text.append("; ").append(remedy);
  if (text.size() > kLongestMessage) text.replace(kLongestMessage, std::string::npos, "...");
  return printable(text);
}

}  // namespace

InputError::InputError(std::string_view where, std::string_view problem, std::string_view remedy)
    : std::runtime_error(joined(where, problem, remedy)) {}

RunError::RunError(std::string_view where, std::string_view problem) : std::runtime_error(joined(where, problem, "")) {}

void expectation_failed(const char* condition, const char* file, int line) noexcept {
  std::fprintf(stderr, "%s:%d: expected %s\n", file, line, condition);
  std::abort();
}

}  // namespace earshot
