// SPDX-License-Identifier: Apache-2.0
#include "datasets/inputs/wished_responses.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::size_t kParts = WishedResponses::kParts;
constexpr int kMostRounds = 10000;
constexpr double kFit = 0.01;

/// The part of a range in which each response lies.
struct WishedProperty {
  const char* option;
  const char* unit;
  double IndexedResponse::*member;
  const std::vector<float>& range;
  std::vector<std::size_t> part = {};

  [[nodiscard]] bool contains(double value) const {
    return value >= static_cast<double>(range[0]) && value <= static_cast<double>(range[1]);  // false where it is not a number
  }
  [[nodiscard]] double edge(std::size_t number) const {
    const auto low = static_cast<double>(range[0]), high = static_cast<double>(range[1]);
    return low + static_cast<double>(number) * (high - low) / kParts;
  }
  void add(double value) {
    const double position = kParts * (value - edge(0)) / (edge(kParts) - edge(0));
    part.push_back(std::min(kParts - 1, static_cast<std::size_t>(std::max(0.0, position))));
  }
  [[nodiscard]] std::array<double, kParts> sums(const std::vector<double>& weights) const {
    std::array<double, kParts> sums{};
    for (std::size_t i = 0; i < weights.size(); ++i) sums[part[i]] += weights[i];
    return sums;
  }
};

/// Weights the responses so that the parts of each property have equal sums.  Returns the largest deviation, relative to a part.
double fit(const std::vector<WishedProperty>& properties, std::vector<double>& weights) {
  constexpr double kVanished = 1e-100;  // parts that exclude each other
  double apart = 1;
  for (int round = 0; round < kMostRounds && apart > 0.1 * kFit; ++round) {
    apart = 0;
    for (const WishedProperty& property : properties) {
      const std::array<double, kParts> sums = property.sums(weights);
      for (const double sum : sums) {
        if (!(sum > kVanished)) return 1;
        apart = std::max(apart, std::abs(sum * kParts - 1));
      }
      for (std::size_t i = 0; i < weights.size(); ++i) weights[i] /= sums[property.part[i]] * kParts;
    }
  }
  return apart;
}

}  // namespace

WishedResponses::WishedResponses(const ResponseIndex& index, const WishedRanges& wished) {
  std::vector<WishedProperty> properties;
  if (!wished.rt60_s.empty()) properties.push_back({"--rt60", "s", &IndexedResponse::t20_mid_s, wished.rt60_s});
  if (!wished.drr_db.empty()) properties.push_back({"--drr", "dB", &IndexedResponse::drr_db, wished.drr_db});
  for (std::size_t i = 0; i < index.responses().size(); ++i) {
    const IndexedResponse& response = index.responses()[i];
    const auto is_wished = [&](const WishedProperty& property) { return property.contains(response.*property.member); };
    if (!std::ranges::all_of(properties, is_wished)) continue;
    responses_.push_back(i);
    for (WishedProperty& property : properties) property.add(response.*property.member);
  }
  std::vector<double> weights(responses_.size(), 1);
  for (const WishedProperty& property : properties) {
    const std::array<double, kParts> sums = property.sums(weights);
    for (std::size_t part = 0; part < kParts; ++part)
      if (sums[part] == 0)
        throw InputError(
            fmt::format("{} {},{}", property.option, property.range[0], property.range[1]),
            fmt::format("finds no response from {:.4g} to {:.4g} {}", property.edge(part), property.edge(part + 1), property.unit),
            "narrow the range, or write a corpus with more and other rooms");
  }
  if (fit(properties, weights) > kFit)
    throw InputError("--rt60 and --drr", "ask for responses that this corpus lacks: the two properties depend on each other",
                     "narrow one of the ranges, or write a corpus with more distances and rooms");
  double sum = 0;
  for (const double weight : weights) until_.push_back(sum += weight);
}

std::size_t WishedResponses::draw(float fraction) const {
  const auto at = std::ranges::upper_bound(until_, static_cast<double>(fraction) * until_.back());
  return responses_[std::min(responses_.size() - 1, static_cast<std::size_t>(at - until_.begin()))];
}

}  // namespace earshot
