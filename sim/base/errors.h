// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <concepts>
#include <sstream>
#include <string>
#include <string_view>

#include "earshot/errors.h"  // InputError: main prints it as one line and exits with 2.  RunError: with 1.
#include "sim/base/strict_floats.h"

namespace earshot {

/// A configuration rule: throws InputError "key = value: rule" when `ok` is false.
/// rule: what must hold and why, for example "must be positive: each ray carries 1/rays of the energy".
template <class T>
void require(bool ok, std::string_view key, const T& value, std::string_view rule) {
  if (ok) return;
  std::ostringstream shown;
  shown << key << " = " << value;
  throw InputError(shown.str(), rule, "correct it in the config file or on the command line");
}

/// Writes "FILE:LINE: expected CONDITION" to stderr and aborts.
[[noreturn]] void expectation_failed(const char* condition, const char* file, int line) noexcept;

}  // namespace earshot

/// A caller's bug: ends the process with a line that names the condition and the place.  Checked in every build: the conditions compare
/// sizes at the head of functions, 1 part in 10^4 of the instructions of a response.
#define EARSHOT_EXPECT(condition) ((condition) ? static_cast<void>(0) : ::earshot::expectation_failed(#condition, __FILE__, __LINE__))
