#include "sim/acoustics/accuracy/accuracy_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kMargin = 0.85;  ///< of the target: places are few
/// Of the target: standard error of the paths in one value, at kMostPlaces places.  Fewer have fewer values, each known the better.
constexpr double kReferenceFraction = 0.7;
constexpr int kMostRuns = 1024, kSeeds = 4, kRaysOfSeeds = 4096;
/// Errors above these say nothing of a bias: with so few rays most decays are not there at all.
constexpr AccuracyErrors kSaturated = {0.3, 3, 3};
constexpr double kNoGain = 0.95;  ///< four times the work should halve a random error: as little gain as this is a bias

using Clock = std::chrono::steady_clock;
double ms_since(Clock::time_point begin) { return std::chrono::duration<double, std::milli>(Clock::now() - begin).count(); }

struct EarlyLevel {
  int order, candidate_rays, reflections;
  int edge_rays;  ///< with a field, which has no rays, they say how far edges are carried alone (DiffractionBudget)
};
constexpr std::array<EarlyLevel, 4> kEarly{{{1, 2000, 0, 64}, {2, 2000, 0, 64}, {3, 10'000, 0, 512}, {4, 50'000, 1, 512}}};
constexpr std::size_t kUsualEarly = 1;

void set_early(std::size_t level, AcousticConfig& config) {
  config.early_order = kEarly[level].order;
  config.early_candidate_rays = kEarly[level].candidate_rays;
  config.diffraction_reflections = kEarly[level].reflections;
  config.rays = kEarly[level].edge_rays;
}

std::vector<glm::vec3> spread(const std::vector<glm::vec3>& places) {
  const std::size_t count = std::min(places.size(), kMostPlaces);
  std::vector<glm::vec3> some;
  for (std::size_t i = 0; i < count; ++i) some.push_back(places[count == 1 ? 0 : i * (places.size() - 1) / (count - 1)]);
  return some;
}

/// Tries candidates, from cheap to dear, and keeps what it saw.
class Search {
 public:
  Search(const std::shared_ptr<const Scene>& scene, const AccuracyRequest& request, const AccuracyReference& reference,
         std::vector<AccuracyChoice>& tried)
      : scene_(scene), request_(request), reference_(reference), tried_(tried), best_ms_(request.most_ms) {}

  void listener_rays(const AcousticConfig& early) {
    AcousticConfig config = early;
    config.field = Switch::off;
    ladder("listener rays", {config, 16, 0}, 16'384);
  }

  void both_ends(const AcousticConfig& early) {
    AcousticConfig config = early;
    config.field = Switch::off;
    config.diffuse_last_segment = false;
    config.source_bounces = 60;
    ladder("both ends", {config, 256, 4}, 65'536);
  }

  /// One field that is refined, tried after each step.
  void source_field(const AcousticConfig& early, float cell_m) {
    AcousticConfig config = early;
    config.field = Switch::on;
    config.source_rays = 0;
    config.field_cell_m = cell_m;
    config.field_photons = 1 << 18;
    config.field_error = 0.5f * static_cast<float>(request_.target.of(AccuracyKind::t20).value_or(0.05));
    if (config.specular_exponent > 0.f) return;
    const AcousticScene acoustics(scene_, config);
    if (!uses_source_field(acoustics)) return;
    static_cast<void>(acoustics.field_grid());  // once per scene, not per source
    const auto begin = Clock::now();
    const EarlyCandidates candidates(acoustics, request_.source);
    double per_source_ms = ms_since(begin);
    SourceFieldBuilder builder(acoustics, candidates);
    double last_used = std::numeric_limits<double>::infinity();
    std::uint64_t last_photons = 1;
    while (true) {
      const auto refined = Clock::now();
      if (!builder.refine()) return;
      const std::shared_ptr<const SourceField> field = builder.snapshot();
      per_source_ms += ms_since(refined);
      AccuracyChoice choice{.method = "source field", .config = config, .per_source_ms = per_source_ms};
      choice.config.field_photons = static_cast<int>(builder.photons());
      choice.config.field_error = 1e-4f;  // the photons decide
      try_responses({&acoustics, 1}, candidates, field.get(), reference_, choice);
      const double used = record(choice);
      if (used <= kMargin || choice.total_ms(request_.poses) > best_ms_) return;
      if (builder.photons() < 2 * last_photons) continue;
      if (is_biased(choice, last_used)) return;
      last_used = used;
      last_photons = builder.photons();
    }
  }

  /// Fewer images, where they do as well.
  void fewer_images() {
    if (!best_) return;
    AcousticConfig config = tried_[*best_].config;
    const int rays = config.rays;
    set_early(0, config);
    config.rays = rays;
    record(try_config(scene_, tried_[*best_].method, config, request_.source, reference_, kSeeds));
  }

  [[nodiscard]] std::optional<std::size_t> best() const { return best_; }

 private:
  struct Rays {
    AcousticConfig config;
    int first;
    int per_source_ray;  ///< 0: none from the source
    [[nodiscard]] AcousticConfig with(int rays) const {
      AcousticConfig result = config;
      result.rays = rays;
      result.source_rays = per_source_ray > 0 ? rays / per_source_ray : 0;
      return result;
    }
  };

  /// Four times as many until they do, then twice as few.
  void ladder(const char* method, const Rays& rays, int most) {
    double last_used = std::numeric_limits<double>::infinity();
    for (int count = rays.first; count <= most; count *= 4) {
      const double used = try_rays(method, rays.with(count));
      if (used <= kMargin) {
        if (count > rays.first) try_rays(method, rays.with(count / 2));
        return;
      }
      if (is_biased(tried_.back(), last_used) || tried_.back().total_ms(request_.poses) > best_ms_) return;
      last_used = used;
    }
  }

  double try_rays(const char* method, const AcousticConfig& config) {
    return record(try_config(scene_, method, config, request_.source, reference_, std::clamp(kRaysOfSeeds / config.rays, 1, kSeeds)));
  }

  /// Has four times the work brought too little?
  [[nodiscard]] bool is_biased(const AccuracyChoice& choice, double last_used) const {
    for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind)
      if (request_.target.most[kind] && choice.predicted[kind] > kSaturated[kind]) return false;
    return request_.target.used(choice.predicted) > kNoGain * last_used;
  }

  /// What it uses of the target.
  double record(const AccuracyChoice& choice) {
    tried_.push_back(choice);
    const double used = request_.target.used(choice.predicted), total_ms = choice.total_ms(request_.poses);
    if (used <= kMargin && total_ms < best_ms_) {
      best_ = tried_.size() - 1;
      best_ms_ = total_ms;
    }
    return used;
  }

  const std::shared_ptr<const Scene>& scene_;
  const AccuracyRequest& request_;
  const AccuracyReference& reference_;
  std::vector<AccuracyChoice>& tried_;
  std::optional<std::size_t> best_;
  double best_ms_;
};

}  // namespace

std::span<const std::string_view> keys_of_accuracy() {
  static constexpr std::array<std::string_view, 11> keys = {
      "rays",          "source_rays", "source_bounces", "early_order",          "early_candidate_rays",   "field",
      "field_photons", "field_error", "field_cell_m",   "diffuse_last_segment", "diffraction_reflections"};
  return keys;
}

AccuracyPlan plan_accuracy(const std::shared_ptr<const Scene>& scene, const AccuracyRequest& request,
                           const std::function<void(double fraction)>& progress) {
  EARSHOT_EXPECT(!request.places.empty() && request.poses > 0);
  const auto begin = Clock::now();
  AccuracyPlan plan;
  AccuracyReference reference(scene, request.config, request.source, spread(request.places));
  const double places = static_cast<double>(reference.places().size()) / kMostPlaces;
  reference.refine(request.target, kReferenceFraction * std::sqrt(places), static_cast<int>(kMostRuns / places), [&](double fraction) {
    if (progress) progress(0.8 * fraction);
  });
  plan.reference_error = reference.standard_error();
  plan.reference_runs = reference.runs();
  for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind)
    if (request.target.most[kind] && std::isnan(plan.reference_error[kind]))
      throw InputError("accuracy " + request.target.text(),
                       fmt::format("asks for {}, which has no value at any of the places in {}",
                                   unit_of(static_cast<AccuracyKind>(kind)).name, scene->name()),
                       "leave it out, or give a longer rir_length_s");
  if (request.target.used(plan.reference_error) > 1)
    throw InputError("accuracy " + request.target.text(),
                     fmt::format("cannot be judged in {}: {} runs of paths from both ends leave a standard error of {}", scene->name(),
                                 plan.reference_runs, text_of(plan.reference_error)),
                     "ask for less, or use --preset high");
  Search search(scene, request, reference, plan.tried);
  const bool asks_for_levels = request.target.of(AccuracyKind::drr) || request.target.of(AccuracyKind::edc);
  for (std::size_t early = kUsualEarly; early < kEarly.size(); ++early) {
    if (early > kUsualEarly && !asks_for_levels) break;  // decay times do not come from images
    AcousticConfig config = request.config;
    set_early(early, config);
    // A field first: what it costs bounds how far the others are carried.
    for (const float cell_m : {1.f, 0.5f}) search.source_field(config, cell_m);
    if (early == kUsualEarly || !search.best()) {
      search.listener_rays(config);
      search.both_ends(config);
    }
    if (early == kUsualEarly) search.fewer_images();
    if (progress) progress(0.8 + 0.2 * static_cast<double>(early) / (kEarly.size() - 1));
  }
  plan.calibration_s = 1e-3 * ms_since(begin);
  if (!search.best()) {
    const auto closest =
        std::ranges::min_element(plan.tried, {}, [&](const AccuracyChoice& choice) { return request.target.used(choice.predicted); });
    const bool too_dear = request.target.used(closest->predicted) <= kMargin;
    throw InputError(
        "accuracy " + request.target.text(),
        fmt::format(
            "cannot be promised in {}: {}the closest of {} candidates, {}, is at {} (standard error of the paths that judge it: {})",
            scene->name(), too_dear ? "it takes longer than allowed; " : "", plan.tried.size(), closest->method,
            text_of(closest->predicted), text_of(plan.reference_error)),
        fmt::format("ask for less ({:.0f} % of it must be kept at the places), or use --preset high", 100 * kMargin));
  }
  plan.chosen = *search.best();
  if (progress) progress(1);
  return plan;
}

std::vector<std::string> settings_of(const AccuracyChoice& choice) {
  const AcousticConfig& config = choice.config;
  std::vector<std::string> settings = {fmt::format("rir_length_s={}", config.rir_length_s),
                                       fmt::format("source_radius_m={}", config.source_radius_m),
                                       fmt::format("source_rays={}", config.source_rays),
                                       fmt::format("rays={}", config.rays),
                                       fmt::format("early_order={}", config.early_order),
                                       fmt::format("early_candidate_rays={}", config.early_candidate_rays),
                                       fmt::format("diffraction_reflections={}", config.diffraction_reflections),
                                       fmt::format("field={}", config.field == Switch::on ? "on" : "off")};
  if (config.field == Switch::on) {
    settings.push_back(fmt::format("field_photons={}", config.field_photons));
    settings.push_back(fmt::format("field_error={}", config.field_error));
    settings.push_back(fmt::format("field_cell_m={}", config.field_cell_m));
    return settings;
  }
  if (config.source_rays > 0) {
    settings.push_back(fmt::format("source_bounces={}", config.source_bounces));
    settings.push_back(fmt::format("diffuse_last_segment={}", config.diffuse_last_segment));
  }
  return settings;
}

}  // namespace earshot
