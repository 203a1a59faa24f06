#include "sim/audio/directivity.h"

#include <array>
#include <string>

#include "sim/base/errors.h"

namespace earshot {
namespace {

class FirstOrder final : public Directivity {
 public:
  explicit FirstOrder(float omni_share) : omni_(omni_share) {}
  [[nodiscard]] float pressure(glm::vec3 direction, float) const override { return omni_ - (1.f - omni_) * direction.z; }
  [[nodiscard]] bool omnidirectional() const override { return omni_ == 1.f; }

 private:
  float omni_;
};

}  // namespace

std::shared_ptr<const Directivity> Directivity::first_order(float omni_share) {
  require(omni_share >= 0.f && omni_share <= 1.f, "omni share", omni_share, "must be in [0, 1]");
  return std::make_shared<const FirstOrder>(omni_share);
}

std::shared_ptr<const Directivity> Directivity::named(std::string_view name) {
  struct Entry {
    std::string_view name;
    float omni_share;
  };
  static constexpr std::array<Entry, 6> known{
      {{"omni", 1.f}, {"subcardioid", 0.7f}, {"cardioid", 0.5f}, {"supercardioid", 0.37f}, {"hypercardioid", 0.25f}, {"dipole", 0.f}}};
  for (const Entry& entry : known)
    if (entry.name == name) return first_order(entry.omni_share);
  throw InputError("directivity '" + std::string(name) + "'", "is not a known pattern",
                   "use omni, subcardioid, cardioid, supercardioid, hypercardioid or dipole");
}

BandDirectivity::BandDirectivity(std::shared_ptr<const Directivity> pattern, std::span<const float> centre_hz)
    : pattern_(std::move(pattern)),
      centre_hz_(centre_hz.begin(), centre_hz.end()),
      omnidirectional_(!pattern_ || pattern_->omnidirectional()) {}

void BandDirectivity::pressure(glm::vec3 direction, std::span<float> gain) const {
  for (std::size_t i = 0; i < gain.size(); ++i) gain[i] = omnidirectional_ ? 1.f : pattern_->pressure(direction, centre_hz_[i]);
}

}  // namespace earshot
