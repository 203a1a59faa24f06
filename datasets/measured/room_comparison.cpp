// SPDX-License-Identifier: Apache-2.0
#include "datasets/measured/room_comparison.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>

#include "sim/acoustics/metrics/standard_errors.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/response/place_check.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kComparedDownToDb = -25;
/// Noises under which each place is rendered: one draw alone moves an octave's DRR by up to 1 dB.
constexpr std::size_t kCarriers = 8;

/// Sizes and signed values of differences.
class Differences {
 public:
  void add(std::optional<double> difference) {
    if (!difference) return;
    ++count_, sizes_ += std::abs(*difference), sum_ += *difference;
  }
  [[nodiscard]] ComparedValue mean() const {
    if (count_ == 0) return {};
    return {.count = count_, .error = sizes_ / count_, .bias = sum_ / count_};
  }

 private:
  int count_ = 0;
  double sizes_ = 0, sum_ = 0;
};

using Value = std::optional<double> BandMetrics::*;

std::optional<double> percent(const OctaveDecay& measured, const OctaveDecay& simulated, Value value) {
  const auto from = measured.metrics.*value, to = simulated.metrics.*value;
  return from && to ? std::optional(100 * (*to / *from - 1)) : std::nullopt;
}
std::optional<double> decibels(const OctaveDecay& measured, const OctaveDecay& simulated, Value value) {
  const auto from = measured.metrics.*value, to = simulated.metrics.*value;
  return from && to ? std::optional(*to - *from) : std::nullopt;
}

SoundSource source_of(const AcousticScene& scene, const MeasuredRoom& room, const MeasuredResponse& response) {
  SoundSource source(scene.scene().to_local(response.source_m));
  source.directivity = room.source_pattern;
  source.orientation = response.source_orientation;
  return source;
}

/// Those of both that have the same centre.
void keep_common(std::vector<OctaveDecay>& a, std::vector<OctaveDecay>& b) {
  const auto has = [](const std::vector<OctaveDecay>& decays, double hz) {
    return std::ranges::any_of(decays, [&](const OctaveDecay& decay) { return decay.centre_hz == hz; });
  };
  std::erase_if(a, [&](const OctaveDecay& decay) { return !has(b, decay.centre_hz); });
  std::erase_if(b, [&](const OctaveDecay& decay) { return !has(a, decay.centre_hz); });
}

}  // namespace

std::optional<double> decay_difference_db(const OctaveDecay& measured, const OctaveDecay& simulated) {
  double squares = 0;
  int count = 0;
  for (std::size_t i = 0; i < measured.level_db.size() && measured.level_db[i] > kComparedDownToDb; ++i) {
    const double level_db = i < simulated.level_db.size() ? simulated.level_db[i] : -80.0;
    squares += std::pow(level_db - measured.level_db[i], 2);
    ++count;
  }
  return count < 3 ? std::nullopt : std::optional(std::sqrt(squares / count));
}

void summarize(RoomComparison& comparison) {
  Differences t20, edt, drr, c50, decay;
  for (const ComparedPlace& place : comparison.places)
    for (std::size_t b = 0; b < place.measured.size(); ++b) {
      const OctaveDecay &measured = place.measured[b], &simulated = place.simulated[b];
      t20.add(percent(measured, simulated, &BandMetrics::t20_s));
      edt.add(percent(measured, simulated, &BandMetrics::edt_s));
      if (measured.centre_hz >= kLowestDrrHz) drr.add(decibels(measured, simulated, &BandMetrics::drr_db));
      c50.add(decibels(measured, simulated, &BandMetrics::c50_db));
      decay.add(decay_difference_db(measured, simulated));
    }
  comparison.t20_percent = t20.mean(), comparison.edt_percent = edt.mean(), comparison.drr_db = drr.mean();
  comparison.c50_db = c50.mean(), comparison.decay_db = decay.mean();
  comparison.decay_db.bias.reset();
}

void check_places(const AcousticScene& scene, const MeasuredRoom& room) {
  const PlaceCheck check(scene);
  for (const MeasuredResponse& response : room.responses) {
    const glm::vec3 source = scene.scene().to_local(response.source_m), listener = scene.scene().to_local(response.listener_m);
    const std::string from = "source of " + response.name, to = "listener of " + response.name;
    (void)check.check({from, source}, {to, listener});
  }
}

RoomComparison compare_room(const AcousticScene& scene, const MeasuredRoom& room, const std::function<void(std::size_t done)>& progress) {
  RirSynthesizer synthesizer(make_synthesis_tables(scene.config(), scene.bands(), ListenerLayout::named("mono"), nullptr));
  RoomComparison comparison;
  EnergyResponse response;
  Rir rir;
  std::array<std::vector<float>, kCarriers> records;
  for (std::size_t i = 0; i < room.responses.size(); ++i) {
    const MeasuredResponse& measured = room.responses[i];
    const EarlyCandidates candidates(scene, source_of(scene, room, measured));
    const glm::vec3 listener = scene.scene().to_local(measured.listener_m);
    compute_energy_response(scene, candidates, listener, response);
    for (std::uint64_t k = 0; k < records.size(); ++k) {
      synthesizer.render(response, ListenerOrientation(0.f),
                         CarrierKey(carrier_key(scene.hash(), candidates.source()) ^ (k * kCarrierStep), listener), rir);
      records[k] = rir.samples;
    }
    ComparedPlace place{.name = measured.name,
                        .distance_m = glm::length(measured.listener_m - measured.source_m),
                        .measured = octave_decays(measured.samples, room.sample_rate_hz, measured.direct_delay_s),
                        .simulated = octave_decays(
                            rir.channel(0), rir.sample_rate_hz,
                            glm::length(measured.listener_m - measured.source_m) / static_cast<double>(scene.speed_of_sound_m_per_s()))};
    keep_common(place.measured, place.simulated);
    if (place.measured.empty())
      throw InputError(measured.name, "has no octave from 250 Hz to 4 kHz in common with the simulation", "use a rate of 1 kHz or more");
    if (comparison.bands_hz.empty())
      for (const OctaveDecay& decay : place.measured) comparison.bands_hz.push_back(decay.centre_hz);
    comparison.places.push_back(std::move(place));
    if (progress) progress(i + 1);
  }
  summarize(comparison);
  return comparison;
}

}  // namespace earshot
