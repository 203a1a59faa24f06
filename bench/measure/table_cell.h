// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <string>

namespace earshot {

/// A number of a Markdown table; "-" where it is not finite.
inline std::string table_cell(double value, const char* digits = "{:.3g}") {
  return std::isfinite(value) ? fmt::format(fmt::runtime(digits), value) : std::string("-");
}

}  // namespace earshot
