// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/directivity.h"

#include <algorithm>
#include <array>

#include "sim/audio/head/measured_directivity.h"
#include "sim/audio/measured/angle_grid.h"
#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

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

void Directivity::band_pressure(FrequencyRange band, std::span<float> at_nodes) const {
  for (std::size_t node = 0; node < AngleGrid::kNodes; ++node) at_nodes[node] = pressure(AngleGrid::direction(node), band.centre_hz);
}

BandDirectivity::BandDirectivity(std::shared_ptr<const Directivity> pattern, std::span<const float> centre_hz,
                                 std::span<const float> edge_hz)
    : omni_weight_(pattern ? pattern->omni_weight() : 1.f), num_bands_(centre_hz.size()) {
  EARSHOT_EXPECT(edge_hz.empty() || edge_hz.size() == centre_hz.size() + 1);
  if (omni_weight_) return;
  table_.resize(AngleGrid::kNodes * num_bands_);
  std::vector<float> at_nodes(AngleGrid::kNodes);
  for (std::size_t b = 0; b < num_bands_; ++b) {
    if (edge_hz.empty())
      pattern->Directivity::band_pressure({centre_hz[b], centre_hz[b], centre_hz[b]}, at_nodes);
    else
      pattern->band_pressure({edge_hz[b], centre_hz[b], edge_hz[b + 1]}, at_nodes);
    for (std::size_t node = 0; node < AngleGrid::kNodes; ++node) table_[node * num_bands_ + b] = at_nodes[node];
  }
}

void BandDirectivity::pressure(glm::vec3 direction, std::span<float> gain) const {
  if (omni_weight_) {
    std::fill(gain.begin(), gain.end(), *omni_weight_ - (1.f - *omni_weight_) * direction.z);
    return;
  }
  const AngleGrid::Place<float> place = AngleGrid::find<float>(direction);
  const auto cell = [&](std::size_t corner) { return table_.data() + place.node[corner] * num_bands_; };
  const float *a = cell(0), *b = cell(1), *c = cell(2), *d = cell(3);
  for (std::size_t i = 0; i < gain.size(); ++i) gain[i] = place.between(a[i], b[i], c[i], d[i]);
}

}  // namespace earshot
