// SPDX-License-Identifier: Apache-2.0
#pragma once

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

/// Throws CallError with RLRA_InvalidParameter.
inline void check(bool is_valid, const std::string& line) {
  if (!is_valid) throw CallError(RLRA_InvalidParameter, line);
}

}  // namespace earshot::compat
