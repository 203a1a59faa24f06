// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/accuracy/accuracy_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <utility>

namespace earshot {
namespace {

constexpr int kSeeds = 4, kRaysOfSeeds = 4096;
/// Photons of one field err together at all places, so that the spread over places does not show how lucky a field was: the worse of two
/// counts.
constexpr std::uint64_t kFields = 2, kFieldsApart = 1'000'003;
/// Errors above these say nothing of a bias: with so few rays most decays are not there at all.
constexpr AccuracyErrors kSaturated = {0.3, 3, 3};
constexpr double kNoGain = 0.95;  ///< four times the work should halve a random error: as little gain as this is a bias

int seeds_of(int rays) { return std::clamp(kRaysOfSeeds / rays, 1, kSeeds); }

struct EarlyLevel {
  int order, candidate_rays, reflections;
  int edge_rays;  ///< with a field, which has no rays, they limit the diffraction paths only (DiffractionBudget)
};
constexpr std::array<EarlyLevel, kNumEarlyLevels> kEarly{{{1, 2000, 0, 64}, {2, 2000, 0, 64}, {3, 10'000, 0, 512}, {4, 50'000, 1, 512}}};

/// The field of one site while it is refined.
class FieldTrial {
 public:
  FieldTrial(const AccuracySite& site, const AcousticConfig& config) : scene_(site.scene, config) {
    if (!uses_source_field(scene_)) return;
    static_cast<void>(scene_.field_grid());  // once per scene, not per source
    const Stopwatch watch;
    candidates_.emplace(scene_, site.source);
    builder_.emplace(scene_, *candidates_);
    per_source_ms_ = spent_ms(watch, config);
  }
  [[nodiscard]] bool has_field() const { return builder_.has_value(); }
  /// false: it has all the photons that it may have.
  bool refine() {
    const Stopwatch watch;
    if (!builder_->refine()) return false;
    field_ = builder_->snapshot();
    per_source_ms_ += spent_ms(watch, scene_.config());
    return true;
  }
  [[nodiscard]] std::uint64_t photons() const { return builder_->photons(); }
  void try_at(const AccuracyReference& reference, AccuracyChoice& choice) const {
    choice.per_source_ms = per_source_ms_;
    try_responses({&scene_, 1}, *candidates_, field_.get(), reference, choice);
  }

 private:
  AcousticScene scene_;
  std::optional<EarlyCandidates> candidates_;
  std::optional<SourceFieldBuilder> builder_;
  std::shared_ptr<const SourceField> field_;
  double per_source_ms_ = 0;
};

}  // namespace

void set_early_level(std::size_t level, AcousticConfig& config) {
  config.early_order = kEarly[level].order;
  config.early_candidate_rays = kEarly[level].candidate_rays;
  config.diffraction_reflections = kEarly[level].reflections;
  config.rays = kEarly[level].edge_rays;
}

struct AccuracySearch::RayLadder {
  AcousticConfig config;
  int first, most;
  int per_source_ray;  ///< 0: none from the source
  [[nodiscard]] AcousticConfig with_rays(int rays) const {
    AcousticConfig result = config;
    result.rays = rays;
    result.source_rays = per_source_ray > 0 ? rays / per_source_ray : 0;
    return result;
  }
};

void AccuracySearch::listener_rays(const AcousticConfig& early) {
  AcousticConfig config = early;
  config.field = Switch::off;
  climb("listener rays", {config, 16, 16'384, 0});
}

void AccuracySearch::both_ends(const AcousticConfig& early) {
  AcousticConfig config = early;
  config.field = Switch::off;
  config.diffuse_last_segment = false;
  config.source_bounces = 60;
  climb("both ends", {config, 256, 65'536, 4});
}

void AccuracySearch::source_field(const AcousticConfig& early, float cell_m) {
  if (early.specular_exponent != 0.f) return;
  AcousticConfig config = early;
  config.field = Switch::on;
  config.source_rays = 0;
  config.field_cell_m = cell_m;
  config.field_photons = 1 << 18;
  config.field_error = 1e-4f;  // the photons decide: four times as many in each step
  std::vector<std::unique_ptr<FieldTrial>> trials;
  for (std::uint64_t i = 0; i < kFields; ++i)
    for (const AccuracySite& site : request_.sites) {
      AcousticConfig seeded = config;
      seeded.seed += i * kFieldsApart;
      trials.push_back(std::make_unique<FieldTrial>(site, seeded));
      if (!trials.back()->has_field()) return;
    }
  double last_used = std::numeric_limits<double>::infinity();
  std::uint64_t first_photons = 0;
  while (true) {
    for (const auto& trial : trials)
      if (!trial->refine()) return;
    const std::uint64_t photons = trials.front()->photons();
    if (first_photons == 0) first_photons = photons;
    std::vector<AccuracyChoice> at_sites;
    for (std::size_t i = 0; i < trials.size(); ++i) {
      EARSHOT_EXPECT(trials[i]->photons() == photons);  // rounds are as large everywhere
      AccuracyChoice& choice = at_sites.emplace_back(AccuracyChoice{.method = "source field", .config = config});
      choice.config.field_photons = static_cast<int>(photons);
      trials[i]->try_at(references_[i % references_.size()], choice);
    }
    AccuracyChoice choice = worst_of(at_sites);
    const double used = record(choice);
    if (used <= kAccuracyMargin) {
      if (photons == first_photons) return;
      choice.config.field_photons /= 2;
      record(try_at_all(choice.method, choice.config));
      return;
    }
    if (is_biased(choice, last_used) || choice.total_ms(request_.poses) > best_ms_) return;
    last_used = used;
  }
}

void AccuracySearch::fewer_images() {
  if (!best_) return;
  const AccuracyChoice best = tried_[*best_];
  for (std::size_t level = kNumEarlyLevels; level-- > 0;) {
    if (kEarly[level].order >= best.config.early_order) continue;
    AcousticConfig config = best.config;
    set_early_level(level, config);
    config.rays = best.config.rays;  // the energy of diffraction paths stays
    if (record(try_at_all(best.method, config)) > kAccuracyMargin) return;
  }
}

void AccuracySearch::climb(const char* method, const RayLadder& ladder) {
  const auto try_rays = [&](int rays) { return record(try_at_all(method, ladder.with_rays(rays))); };
  double last_used = std::numeric_limits<double>::infinity();
  for (int rays = ladder.first; rays <= ladder.most; rays *= 4) {
    const double used = try_rays(rays);
    if (used <= kAccuracyMargin) {
      if (rays > ladder.first) try_rays(rays / 2);
      return;
    }
    if (is_biased(tried_.back(), last_used) || tried_.back().total_ms(request_.poses) > best_ms_) return;
    last_used = used;
  }
}

AccuracyChoice AccuracySearch::try_at_all(const std::string& method, const AcousticConfig& config) const {
  const bool is_field = config.field == Switch::on;
  std::vector<AccuracyChoice> at_sites;
  for (std::uint64_t field = 0; field < (is_field ? kFields : 1); ++field)
    for (std::size_t i = 0; i < request_.sites.size(); ++i) {
      AcousticConfig seeded = config;
      seeded.seed += field * kFieldsApart;
      at_sites.push_back(try_config(request_.sites[i].scene, method, seeded, request_.sites[i].source, references_[i],
                                    is_field ? 1 : seeds_of(config.rays)));
    }
  return worst_of(at_sites);
}

/// Has four times the work brought too little?
bool AccuracySearch::is_biased(const AccuracyChoice& choice, double last_used) const {
  for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind)
    if (request_.target.most[kind] && choice.predicted[kind] > kSaturated[kind]) return false;
  return request_.target.used(choice.predicted) > kNoGain * last_used;
}

/// Fraction of the target that it uses.
double AccuracySearch::record(AccuracyChoice choice) {
  const double used = request_.target.used(choice.predicted), total_ms = choice.total_ms(request_.poses);
  tried_.push_back(std::move(choice));
  if (used <= kAccuracyMargin && total_ms < best_ms_) {
    best_ = tried_.size() - 1;
    best_ms_ = total_ms;
  }
  return used;
}

}  // namespace earshot
