// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/accuracy/accuracy_target.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::array<AccuracyUnit, kNumAccuracyKinds> kUnits{{{"t20", "%", 100}, {"drr", "dB", 1}, {"edc", "dB", 1}}};

struct Range {
  double least, most;
};
constexpr Range kPercent{1, 50}, kDecibels{0.1, 10};

[[noreturn]] void refuse(const std::string& text, const std::string& problem) {
  throw InputError("accuracy '" + text + "'", problem, "write t20=5%,drr=1dB,edc=1dB or a part of it");
}

}  // namespace

const AccuracyUnit& unit_of(AccuracyKind kind) { return kUnits[static_cast<std::size_t>(kind)]; }

AccuracyTarget AccuracyTarget::parse(const std::string& text) {
  AccuracyTarget target;
  std::string_view rest = text;
  while (true) {
    const std::size_t comma = rest.find(',');
    const std::string_view item = rest.substr(0, comma);
    const std::size_t equals = item.find('=');
    const std::string_view name = item.substr(0, equals);
    const auto unit = std::find_if(kUnits.begin(), kUnits.end(), [&](const AccuracyUnit& known) { return name == known.name; });
    if (equals == std::string_view::npos || unit == kUnits.end()) refuse(text, fmt::format("'{}' is not one of t20=, drr= and edc=", item));
    const std::string_view value = item.substr(equals + 1);
    double number = 0;
    const auto read = std::from_chars(value.data(), value.data() + value.size(), number);
    const std::string_view suffix(read.ptr, static_cast<std::size_t>(value.data() + value.size() - read.ptr));
    if (read.ec != std::errc() || suffix != unit->suffix) refuse(text, fmt::format("'{}' is not a number in {}", item, unit->suffix));
    const Range range = unit->scale > 1 ? kPercent : kDecibels;
    if (!(number >= range.least && number <= range.most))
      refuse(text, fmt::format("'{}' is outside {} to {} {}", item, range.least, range.most, unit->suffix));
    std::optional<double>& most = target.most[static_cast<std::size_t>(unit - kUnits.begin())];
    if (most) refuse(text, fmt::format("{} is given twice", name));
    most = number / unit->scale;
    if (comma == std::string_view::npos) return target;
    rest.remove_prefix(comma + 1);
  }
}

std::string AccuracyTarget::text() const {
  std::string text;
  for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind)
    if (most[kind])
      text += fmt::format("{}{}={:g}{}", text.empty() ? "" : ",", kUnits[kind].name, *most[kind] * kUnits[kind].scale, kUnits[kind].suffix);
  return text;
}

double AccuracyTarget::used(const AccuracyErrors& errors) const {
  double used = 0;
  for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind)
    if (most[kind] && !std::isnan(errors[kind])) used = std::max(used, errors[kind] / *most[kind]);
  return used;
}

std::string text_of(const AccuracyErrors& errors) {
  std::string text;
  for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind)
    if (!std::isnan(errors[kind]))
      text += fmt::format("{}{} {:.2g} {}", text.empty() ? "" : ", ", kUnits[kind].name, errors[kind] * kUnits[kind].scale,
                          kUnits[kind].suffix);
  return text;
}

}  // namespace earshot
