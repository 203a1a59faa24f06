#include "sim/acoustics/source_field.h"

#include "sim/base/errors.h"

namespace earshot {

struct SourceFieldBuilder::Impl {};

SourceField::SourceField(const AcousticScene&, const EarlyCandidates&, std::span<const std::byte> image, std::shared_ptr<const void> owner)
    : image_(image), owner_(std::move(owner)) {}
TraceStats SourceField::gather(const AcousticScene&, const EarlyCandidates&, glm::vec3, EnergyHistogram&) const {
  throw RunError("source field", "not there yet");
}
std::uint64_t SourceField::photons() const { return 0; }
double SourceField::t20_error() const { return 1; }
std::uint64_t source_field_key(const AcousticScene& scene, const EarlyCandidates&) { return scene.hash(); }
SourceFieldBuilder::SourceFieldBuilder(const AcousticScene&, const EarlyCandidates&) {}
SourceFieldBuilder::~SourceFieldBuilder() = default;
SourceFieldBuilder::SourceFieldBuilder(SourceFieldBuilder&&) noexcept = default;
bool SourceFieldBuilder::refine() { return false; }
double SourceFieldBuilder::t20_error() const { return 1; }
std::uint64_t SourceFieldBuilder::photons() const { return 0; }
std::shared_ptr<const SourceField> SourceFieldBuilder::snapshot() const { return nullptr; }
std::shared_ptr<const SourceField> build_source_field(const AcousticScene& scene, const EarlyCandidates& candidates,
                                                      const std::function<void(double)>&) {
  SourceFieldBuilder builder(scene, candidates);
  while (builder.refine()) {
  }
  return builder.snapshot();
}

}  // namespace earshot
