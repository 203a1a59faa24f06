// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/directivity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "sim/audio/head/measured_directivity.h"
#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

constexpr int kStepsPerQuarter = 18;  // 5 degrees
constexpr int kRows = 2 * kStepsPerQuarter + 1, kColumns = 4 * kStepsPerQuarter;

class FirstOrder final : public Directivity {
 public:
  explicit FirstOrder(float omni_weight) : omni_(omni_weight) {}
  [[nodiscard]] float pressure(glm::vec3 direction, float) const override { return omni_ - (1.f - omni_) * direction.z; }
  [[nodiscard]] bool omnidirectional() const override { return omni_ == 1.f; }
  [[nodiscard]] std::optional<float> omni_weight() const override { return omni_; }

 private:
  float omni_;
};

struct Named {
  std::string_view name;
  float omni_weight;
};
constexpr std::array<Named, 6> kFirstOrder{
    {{"omni", 1.f}, {"subcardioid", 0.7f}, {"cardioid", 0.5f}, {"supercardioid", 0.37f}, {"hypercardioid", 0.25f}, {"dipole", 0.f}}};

constexpr std::array<std::string_view, 5> kClfEndings{".tab", ".txt", ".clf", ".cf1", ".cf2"};
constexpr std::array<std::string_view, 3> kBalloonEndings{".json", ".yaml", ".yml"};

bool ends_with_one_of(std::string_view name, std::span<const std::string_view> endings) {
  return std::ranges::any_of(endings, [&](std::string_view ending) { return name.ends_with(ending); });
}

}  // namespace

std::shared_ptr<const Directivity> Directivity::first_order(float omni_weight) {
  require(omni_weight >= 0.f && omni_weight <= 1.f, "omni_weight", omni_weight, "must be in [0, 1]");
  return std::make_shared<const FirstOrder>(omni_weight);
}

std::shared_ptr<const Directivity> Directivity::named(std::string_view name) {
  for (const Named& entry : kFirstOrder)
    if (entry.name == name) return first_order(entry.omni_weight);
  if (name == "voice") return voice();
  const std::string folded = fold_case(name);
  if (folded.ends_with(".sofa")) return sofa_directivity(std::filesystem::path(name));
  if (ends_with_one_of(folded, kClfEndings)) return clf_directivity(std::filesystem::path(name));
  if (ends_with_one_of(name, kBalloonEndings)) return balloon(std::filesystem::path(name));
  throw InputError("directivity '" + std::string(name) + "'", "is not a known pattern",
                   "use omni, subcardioid, cardioid, supercardioid, hypercardioid, dipole, voice, a balloon file (.json, .yaml), SOFA "
                   "(.sofa) or CLF text (.tab, .txt, .clf)");
}

bool Directivity::is_file(std::string_view name) {
  const std::string folded = fold_case(name);
  return folded.ends_with(".sofa") || ends_with_one_of(folded, kClfEndings) || ends_with_one_of(name, kBalloonEndings);
}

BandDirectivity::BandDirectivity(std::shared_ptr<const Directivity> pattern, std::span<const float> centre_hz)
    : omni_weight_(pattern ? pattern->omni_weight() : 1.f), num_frequencies_(centre_hz.size()) {
  if (omni_weight_) return;
  table_.reserve(static_cast<std::size_t>(kRows * kColumns) * num_frequencies_);
  constexpr double step_rad = 0.5 * std::numbers::pi / kStepsPerQuarter;
  for (int row = 0; row < kRows; ++row) {
    const double elevation = (row - kStepsPerQuarter) * step_rad;
    // All directions of a pole's row are the pole.
    const double level = row == 0 || row + 1 == kRows ? 0.0 : std::cos(elevation);
    for (int column = 0; column < kColumns; ++column) {
      const double azimuth = column * step_rad;
      const glm::vec3 direction(-level * std::sin(azimuth), std::sin(elevation), -level * std::cos(azimuth));
      for (const float frequency_hz : centre_hz) table_.push_back(pattern->pressure(direction, frequency_hz));
    }
  }
}

void BandDirectivity::pressure(glm::vec3 direction, std::span<float> gain) const {
  if (omni_weight_) {
    std::fill(gain.begin(), gain.end(), *omni_weight_ - (1.f - *omni_weight_) * direction.z);
    return;
  }
  constexpr float steps_per_rad = kStepsPerQuarter / (0.5f * std::numbers::pi_v<float>);
  // atan2 for the elevation too: near a pole the arc sine of a float is good to 0.02 degrees only.
  const float height = std::atan2(direction.y, std::hypot(direction.x, direction.z)) * steps_per_rad + kStepsPerQuarter;
  const float around = std::atan2(-direction.x, -direction.z) * steps_per_rad + kColumns;  // at least half a turn, never negative
  const auto row = static_cast<std::size_t>(std::clamp(height, 0.f, kRows - 2.f + 0.99f));
  const auto column = static_cast<std::size_t>(around);
  const float up = std::min(height - static_cast<float>(row), 1.f), left = around - static_cast<float>(column);
  const auto cell = [&](std::size_t r, std::size_t c) { return table_.data() + (r * kColumns + c % kColumns) * num_frequencies_; };
  const float *a = cell(row, column), *b = cell(row, column + 1), *c = cell(row + 1, column), *d = cell(row + 1, column + 1);
  for (std::size_t i = 0; i < gain.size(); ++i) {
    const float low = a[i] + left * (b[i] - a[i]), high = c[i] + left * (d[i] - c[i]);
    gain[i] = low + up * (high - low);
  }
}

}  // namespace earshot
