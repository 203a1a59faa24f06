// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdio>
#include <stdexcept>
#include <string>

#include "compat/rlr_audio_propagation.h"

namespace earshot::compat {

/// A call that is refused: the code that it returns, and the line that stderr gets.
class CallError : public std::runtime_error {
 public:
  CallError(RLRA_Error code, const std::string& line) : std::runtime_error(line), code_(code) {}
  [[nodiscard]] RLRA_Error code() const { return code_; }

 private:
  RLRA_Error code_;
};

/// "earshot: LINE" on stderr.  A stderr that is closed or full changes no code: the line is lost.
inline void print_line(const std::string& line) { static_cast<void>(std::fputs(("earshot: " + line + "\n").c_str(), stderr)); }

/// Throws CallError with RLRA_InvalidParameter.
inline void check(bool is_valid, const std::string& line) {
  if (!is_valid) throw CallError(RLRA_InvalidParameter, line);
}

}  // namespace earshot::compat
