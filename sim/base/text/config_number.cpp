// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/config_number.h"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <system_error>

namespace earshot {
namespace {

constexpr std::size_t kMaxDigits = 20;  // of 2^64 - 1

/// The parts of a decimal number.
struct Decimal {
  bool is_negative = false;
  std::string digits = {};    ///< before and behind the point, without zeros around them; empty for zero
  std::int64_t exponent = 0;  ///< the value is digits * 10^exponent
};

std::string_view take_digits(std::string_view& text) {
  std::size_t length = 0;
  while (length < text.size() && text[length] >= '0' && text[length] <= '9') ++length;
  const std::string_view digits = text.substr(0, length);
  text.remove_prefix(length);
  return digits;
}

bool take_sign(std::string_view& text) {
  const bool is_negative = text.starts_with('-');
  if (is_negative || text.starts_with('+')) text.remove_prefix(1);
  return is_negative;
}

/// Far beyond the exponent of any type where there are more digits than 64 bits hold.
std::int64_t exponent_of(std::string_view digits) {
  std::int64_t value = 0;
  const auto read = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  return std::min<std::int64_t>(read.ec == std::errc() ? value : INT64_MAX, 1'000'000'000'000);
}

std::optional<Decimal> parts_of(std::string_view text) {
  Decimal decimal{.is_negative = take_sign(text)};
  decimal.digits = take_digits(text);
  bool has_digits = !decimal.digits.empty();
  if (text.starts_with('.')) {
    text.remove_prefix(1);
    const std::string_view fraction = take_digits(text);
    has_digits = has_digits || !fraction.empty();
    decimal.digits += fraction;
    decimal.exponent = -static_cast<std::int64_t>(fraction.size());
  }
  if (!has_digits) return std::nullopt;
  if (text.starts_with('e') || text.starts_with('E')) {
    text.remove_prefix(1);
    const bool is_negative = take_sign(text);
    const std::string_view digits = take_digits(text);
    if (digits.empty()) return std::nullopt;
    decimal.exponent += is_negative ? -exponent_of(digits) : exponent_of(digits);
  }
  if (!text.empty()) return std::nullopt;
  const std::size_t last = decimal.digits.find_last_not_of('0');
  decimal.exponent += static_cast<std::int64_t>(decimal.digits.size() - (last + 1));
  decimal.digits.resize(last + 1);  // npos + 1 is 0
  decimal.digits.erase(0, decimal.digits.find_first_not_of('0'));
  return decimal;
}

}  // namespace

std::optional<std::string> whole_digits(std::string_view text) {
  const std::optional<Decimal> decimal = parts_of(text);
  if (!decimal) return std::nullopt;
  if (decimal->digits.empty()) return "0";
  const auto room = static_cast<std::int64_t>(kMaxDigits) - static_cast<std::int64_t>(decimal->digits.size());
  if (decimal->exponent < 0 || decimal->exponent > room) return std::nullopt;
  return (decimal->is_negative ? "-" : "") + decimal->digits + std::string(static_cast<std::size_t>(decimal->exponent), '0');
}

template <std::integral T>
std::optional<T> parse_whole(std::string_view text) {
  const std::optional<std::string> digits = whole_digits(text);
  if (!digits) return std::nullopt;
  T value{};
  const auto [end, error] = std::from_chars(digits->data(), digits->data() + digits->size(), value);
  return error == std::errc() && end == digits->data() + digits->size() ? std::optional(value) : std::nullopt;
}

template <std::floating_point T>
std::optional<T> parse_decimal(std::string_view text) {
  if (!parts_of(text)) return std::nullopt;
  if (text.starts_with('+')) text.remove_prefix(1);
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() ? std::optional(value) : std::nullopt;
}

std::string decimal_hint(std::string_view text) {
  std::string_view rest = text;
  static_cast<void>(take_sign(rest));
  const bool has_base = rest.size() > 2 && rest[0] == '0' && std::string_view("xXoObB").find(rest[1]) != std::string_view::npos;
  const bool has_separator = !rest.empty() && rest[0] >= '0' && rest[0] <= '9' && rest.find('_') != std::string_view::npos &&
                             rest.find_first_not_of("0123456789_.eE+-") == std::string_view::npos;
  return has_base || has_separator ? "numbers are decimal, without '_' between digits" : "";
}

template std::optional<float> parse_decimal<float>(std::string_view);
template std::optional<double> parse_decimal<double>(std::string_view);
template std::optional<int> parse_whole<int>(std::string_view);
template std::optional<std::uint32_t> parse_whole<std::uint32_t>(std::string_view);
template std::optional<std::int64_t> parse_whole<std::int64_t>(std::string_view);
template std::optional<std::uint64_t> parse_whole<std::uint64_t>(std::string_view);

}  // namespace earshot
