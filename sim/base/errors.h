#pragma once

#include <concepts>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

#include "sim/base/strict_floats.h"

namespace earshot {

/// The outside world is wrong: a file, a key, a message, a device.  `main` prints it as one line and exits with 2.
/// where: file, key or address.  what: what is wrong there.  remedy: what to do about it.
class InputError : public std::runtime_error {
 public:
  InputError(std::string_view where, std::string_view what, std::string_view remedy);
};

/// A run that started well and then failed (a worker died, the disk is full).  `main` exits with 1.
class RunError : public std::runtime_error {
 public:
  RunError(std::string_view where, std::string_view what);
};

/// A configuration rule: throws InputError "key = value: rule" when `ok` is false.
/// rule: what must hold and why, for example "must be positive: each ray carries 1/rays of the energy".
template <class T>
void require(bool ok, std::string_view key, const T& value, std::string_view rule) {
  if (ok) return;
  std::ostringstream shown;
  shown << key << " = " << value;
  throw InputError(shown.str(), rule, "correct it in the config file or on the command line");
}

}  // namespace earshot

/// A caller's bug.  Checked in debug builds; the message names the condition.
#ifdef NDEBUG
#define EARSHOT_EXPECT(condition) static_cast<void>(0)
#else
#include <cassert>
#define EARSHOT_EXPECT(condition) assert(condition)
#endif
