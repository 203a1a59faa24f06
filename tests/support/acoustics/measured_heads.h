// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "tests/support/files/test_data.h"

namespace earshot {

/// A head of shared/data/hrtf as plain numbers.
struct HeadData {
  double rate_hz = 0;
  std::size_t taps = 0;
  std::vector<glm::vec3> direction{};  ///< unit, head axes: x right, y up, -z front
  std::vector<float> samples{};        ///< [direction][ear][tap]
};

/// Directions that come twice are left out.
inline HeadData read_head(const std::string& name) {
  const nlohmann::json json = parse_json(read_file(data_folder() / "hrtf" / (name + ".json")));
  const std::string bytes = read_file(data_folder() / "hrtf" / (name + ".f32"));
  HeadData head{.rate_hz = json.at("fs").get<double>(), .taps = json.at("taps").get<std::size_t>()};
  const std::size_t row = 2 * head.taps;
  std::vector<float> all(bytes.size() / sizeof(float));
  std::memcpy(all.data(), bytes.data(), all.size() * sizeof(float));
  for (std::size_t i = 0; i < json.at("azimuth_elevation_deg").size(); ++i) {
    const auto angles = json.at("azimuth_elevation_deg")[i].get<std::array<double, 2>>();
    const double azimuth = angles[0] * std::numbers::pi / 180, elevation = angles[1] * std::numbers::pi / 180;
    const glm::vec3 towards(-std::sin(azimuth) * std::cos(elevation), std::sin(elevation), -std::cos(azimuth) * std::cos(elevation));
    if (std::ranges::any_of(head.direction, [&](glm::vec3 other) { return glm::dot(other, towards) > 0.9999995f; })) continue;
    head.direction.push_back(towards);
    head.samples.insert(head.samples.end(), all.begin() + static_cast<std::ptrdiff_t>(i * row),
                        all.begin() + static_cast<std::ptrdiff_t>((i + 1) * row));
  }
  return head;
}

/// Centres of thirds of an octave from 250 Hz to 16 kHz.
inline std::vector<double> third_octaves() {
  std::vector<double> centres;
  for (int i = -6; i <= 12; ++i) centres.push_back(1000.0 * std::pow(2.0, i / 3.0));
  return centres;
}

}  // namespace earshot
