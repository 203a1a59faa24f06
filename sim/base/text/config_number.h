// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <concepts>
#include <optional>
#include <string>
#include <string_view>

namespace earshot {

// The numbers of configs and of the command line.  They are decimal: 12, -3, 0.5, .5, 5., 3e6, 1.5E-3, with zeros before them or without
// (010 is ten).  No other base, no separators, neither infinity nor NaN.

/// The number nearest to the text; nothing if it is no decimal number, or too large or too small for the type.
template <std::floating_point T>
std::optional<T> parse_decimal(std::string_view text);
/// Exact; nothing if it is no decimal number, has a fraction or lies outside of the type.  3e6, 1.5e3 and 2.0 are whole.
template <std::integral T>
std::optional<T> parse_whole(std::string_view text);
/// A whole number that no type bounds, as its digits: "3e6" gives "3000000".  Nothing if it is not whole or has more than 20 digits.
std::optional<std::string> whole_digits(std::string_view text);
/// For messages, of a text that other programs take for a number (0x10, 0o17, 1_000): what to write.  Empty for all else.
std::string decimal_hint(std::string_view text);

}  // namespace earshot
