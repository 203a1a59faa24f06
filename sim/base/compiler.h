// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace earshot {

/// Family and major version of the compiler that compiled the including file: "g++12", "clang14".
inline std::string compiler_name() {
#if defined(__clang__)
  return "clang" + std::to_string(__clang_major__);
#elif defined(__GNUC__)
  return "g++" + std::to_string(__GNUC__);
#else
  return "unknown";
#endif
}

}  // namespace earshot
