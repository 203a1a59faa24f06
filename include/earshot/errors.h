// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Errors of the library.  Both classes derive from std::runtime_error; what() is one line that says what is wrong, where, and what to do.
///
/// \code
/// try {
///   earshot::Scene scene("room.glb");
/// } catch (const earshot::InputError& error) {
///   std::cerr << error.what() << '\n';  // room.glb: does not exist; check the path of the mesh
/// }
/// \endcode

#include <stdexcept>
#include <string_view>

// A program that is linked with -ffast-math flushes small numbers to zero in the whole process, libraries included.
#if defined(__FAST_MATH__)
#error "Earshot must not be compiled with -ffast-math: results would depend on the compiler"
#endif

namespace earshot {

/// Something outside the program is wrong: a file, a key, a value, a place, a device.  Correct the input and call again.
class InputError : public std::runtime_error {
 public:
  /// @param where   file, key or address.
  /// @param what    what is wrong there.
  /// @param remedy  what to do about it.
  InputError(std::string_view where, std::string_view what, std::string_view remedy);
};

/// Work that began well and failed later: a full disk, a worker that died.
class RunError : public std::runtime_error {
 public:
  RunError(std::string_view where, std::string_view what);
};

/// Every other public name is declared in `earshot::api` and used as `earshot::NAME`.  The library's own sources, which have types of the
/// same names in `earshot`, are compiled with EARSHOT_ENGINE and write `api::NAME`.
namespace api {}
#ifndef EARSHOT_ENGINE
using namespace api;
#endif

}  // namespace earshot
