// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/config_key.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <utility>

#include "sim/base/text/listed.h"

namespace earshot {
namespace {

bool is_numeric(KeyType type) {
  return type == KeyType::whole_number || type == KeyType::number || type == KeyType::whole_numbers || type == KeyType::numbers;
}

bool is_whole(KeyType type) { return type == KeyType::whole_number || type == KeyType::whole_numbers; }

std::string with_separators(const std::string& digits) {
  std::string text;
  for (std::size_t i = 0; i < digits.size(); ++i) {
    if (i > 0 && (digits.size() - i) % 3 == 0 && digits[i - 1] != '-') text += ',';
    text += digits[i];
  }
  return text;
}

/// "from 0 to 4", "above 0 and at most 60"; empty without bounds.
std::string bounds_text(const Allowed& allowed, const std::string& unit) {
  const bool has_low = std::isfinite(allowed.low), has_high = std::isfinite(allowed.high);
  const std::string tail = unit.empty() ? "" : " " + unit;
  if (has_low && has_high && !allowed.is_low_open && !allowed.is_high_open)
    return fmt::format("from {} to {}{}", number_text(allowed.low), number_text(allowed.high), tail);
  std::string text;
  if (has_low) text = fmt::format("{} {}", allowed.is_low_open ? "above" : "of at least", number_text(allowed.low));
  if (has_high)
    text += (has_low ? " and " : "") + fmt::format("{} {}",
                                                   allowed.is_high_open ? "below"
                                                   : has_low            ? "at most"
                                                                        : "of at most",
                                                   number_text(allowed.high));
  return text.empty() ? text : text + tail;
}

std::string or_other(const Allowed& allowed) {
  if (!allowed.other) return "";
  return ", or " + (allowed.word.empty() ? number_text(*allowed.other) : std::string(allowed.word));
}

/// "a, b or c".
std::string alternatives(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i) text += (i == 0 ? "" : i + 1 < names.size() ? ", " : " or ") + names[i];
  return text;
}

std::string wanted_list(const ConfigKey& key) {
  const Allowed& allowed = key.allowed;
  if (key.type == KeyType::texts) {
    const std::string item = allowed.wanted.empty() ? "text" : std::string(allowed.wanted);
    return (allowed.accepts_scalar ? item + ", or " : "") + "a list of " + item + ", for example [a, b]";
  }
  const std::string numbers = is_whole(key.type) ? "whole numbers" : "numbers";
  const std::string bounds = bounds_text(allowed, unit_of_key(key.name));
  std::string text = allowed.count == 0 ? "a list of " + numbers : fmt::format("a list of {} {}", allowed.count, numbers);
  if (!bounds.empty()) text += " " + bounds;
  return allowed.is_interval ? text + ", in increasing order" : text;
}

}  // namespace

std::string unit_of_key(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, std::string_view>, 17> suffixes{{{"_m_per_s", "m/s"},
                                                                                    {"metres_per_px", "m"},
                                                                                    {"_m2", "m2"},
                                                                                    {"_percent", "%"},
                                                                                    {"_dbfs", "dBFS"},
                                                                                    {"_db", "dB"},
                                                                                    {"_deg", "degrees"},
                                                                                    {"_hz", "Hz"},
                                                                                    {"_kpa", "kPa"},
                                                                                    {"_ms", "ms"},
                                                                                    {"_px", "pixels"},
                                                                                    {"_gb", "GB"},
                                                                                    {"_minutes", "minutes"},
                                                                                    {"_c", "degrees Celsius"},
                                                                                    {"_s", "s"},
                                                                                    {"_m", "m"},
                                                                                    {"_steps", "steps"}}};
  const std::string_view last = name.substr(name.rfind('.') == std::string_view::npos ? 0 : name.rfind('.') + 1);
  for (const auto& [suffix, unit] : suffixes)
    if (last.ends_with(suffix)) return std::string(unit);
  return "";
}

std::string number_text(double value) {
  constexpr double exact = 9007199254740992.0;  // 2^53: beyond, only the bounds of 64-bit types are asked for
  if (std::abs(value) >= exact) {
    int exponent = 0;
    return std::frexp(value, &exponent) == 0.5 ? fmt::format("2^{} - 1", exponent - 1) : fmt::format("{}", value);
  }
  if (value == std::floor(value)) return with_separators(fmt::format("{:.0f}", value));
  const std::string shortest = fmt::format("{}", value);
  if (shortest.find('e') == std::string::npos || std::abs(value) < 1e-9) return shortest;
  std::string text = fmt::format("{:.12f}", value);
  text.erase(text.find_last_not_of('0') + 1);
  return text;
}

std::string type_text(const ConfigKey& key) {
  switch (key.type) {
    case KeyType::section:
      return "section";
    case KeyType::flag:
      return "true or false";
    case KeyType::whole_number:
      return "whole number";
    case KeyType::number:
      return "number";
    case KeyType::text:
      return "text";
    case KeyType::choice:
      return "choice";
    case KeyType::whole_numbers:
      return "list of whole numbers";
    case KeyType::numbers:
      return "list of numbers";
    case KeyType::texts:
      return key.allowed.accepts_scalar ? "text or list" : "list of text";
    case KeyType::nested_numbers:
      return "nested lists of numbers";
  }
  return "";
}

std::string allowed_text(const ConfigKey& key) {
  if (key.type == KeyType::choice) return alternatives(key.choices);
  const Allowed& allowed = key.allowed;
  if (!is_numeric(key.type)) return std::string(allowed.wanted);
  if (allowed.low == allowed.high) return number_text(allowed.low);
  std::string text = bounds_text(allowed, "") + or_other(allowed);
  for (const std::string_view lead : {"from ", "of "})
    if (text.starts_with(lead)) text.erase(0, lead.size());
  if (allowed.multiple > 1) text += fmt::format(", a multiple of {}", allowed.multiple);
  if (allowed.is_interval) return "least and largest, " + text;
  return allowed.count > 0 ? fmt::format("{} numbers, {}", allowed.count, text) : text;
}

std::string wanted_text(const ConfigKey& key) {
  const Allowed& allowed = key.allowed;
  const std::string bounds = bounds_text(allowed, unit_of_key(key.name));
  switch (key.type) {
    case KeyType::section:
      return "a map of keys and values";
    case KeyType::flag:
      return "true or false";
    case KeyType::whole_number: {
      if (allowed.low == allowed.high) return number_text(allowed.low);
      const std::string factor = allowed.multiple > 1 ? fmt::format("a multiple of {} ", allowed.multiple) : "a whole number ";
      return factor + bounds + or_other(allowed);
    }
    case KeyType::number:
      return (bounds.empty() ? "a finite number" : "a number " + bounds) + or_other(allowed);
    case KeyType::text:
      return allowed.wanted.empty() ? "text" : std::string(allowed.wanted);
    case KeyType::choice:
      return alternatives(key.choices);
    case KeyType::nested_numbers:
      return "lists of numbers within lists";
    default:
      return wanted_list(key);
  }
}

}  // namespace earshot
