// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/model/effect_plan.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/scene/air_sample.h"
#include "tests/support/acoustics/rooms.h"

/// Scenes for tests of the effect plan (docs/explanation/effect_bounds.md, section 5), and the difference of two responses.
namespace earshot::effects {

using rooms::point;

struct EffectScene {
  std::string name;
  std::shared_ptr<const Scene> scene;
  glm::vec3 source;
  std::vector<glm::vec3> listeners;
};

inline Material material(double absorption, double scattering, double transmission = 0) {
  return Material::uniform("wall", static_cast<float>(absorption), static_cast<float>(scattering), static_cast<float>(transmission));
}

/// Two rooms of x_m / 2 each, joined by a doorway in the middle of a thin partition; door_m = 0: closed.  Slot 0: shell, 1: partition.
inline std::shared_ptr<const Scene> two_rooms(double x, double y, double z, double door_m, const Material& shell,
                                              const Material& partition) {
  TriangleMesh mesh;
  const auto at = [&](int i, int j, int k) { return point(i * x, j * y, k * z); };
  rooms::append_quad(mesh, {at(0, 0, 0), at(0, 1, 0), at(0, 1, 1), at(0, 0, 1)}, 0);
  rooms::append_quad(mesh, {at(1, 0, 0), at(1, 1, 0), at(1, 1, 1), at(1, 0, 1)}, 0);
  rooms::append_quad(mesh, {at(0, 0, 0), at(1, 0, 0), at(1, 0, 1), at(0, 0, 1)}, 0);
  rooms::append_quad(mesh, {at(0, 1, 0), at(1, 1, 0), at(1, 1, 1), at(0, 1, 1)}, 0);
  rooms::append_quad(mesh, {at(0, 0, 0), at(1, 0, 0), at(1, 1, 0), at(0, 1, 0)}, 0);
  rooms::append_quad(mesh, {at(0, 0, 1), at(1, 0, 1), at(1, 1, 1), at(0, 1, 1)}, 0);
  const double from = 0.5 * (y - door_m), to = 0.5 * (y + door_m), top = door_m > 0 ? std::min(2.1, 0.8 * z) : 0.0;
  const auto panel = [&](double y0, double y1, double z0, double z1) {
    rooms::append_quad(mesh, {point(0.5 * x, y0, z0), point(0.5 * x, y1, z0), point(0.5 * x, y1, z1), point(0.5 * x, y0, z1)}, 1);
  };
  if (door_m > 0) {
    panel(0, from, 0, z);
    panel(to, y, 0, z);
    panel(from, to, top, z);
  } else {
    panel(0, y, 0, z);
  }
  return rooms::scene_of(std::move(mesh), {shell, partition}, Air{});
}

/// A street: ground and two parallel walls.
inline std::shared_ptr<const Scene> canyon() {
  TriangleMesh mesh;
  rooms::append_quad(mesh, {point(0, 0, 0), point(120, 0, 0), point(120, 14, 0), point(0, 14, 0)}, 0);
  rooms::append_quad(mesh, {point(0, 0, 0), point(120, 0, 0), point(120, 0, 12), point(0, 0, 12)}, 1);
  rooms::append_quad(mesh, {point(0, 14, 0), point(120, 14, 0), point(120, 14, 12), point(0, 14, 12)}, 1);
  return rooms::scene_of(std::move(mesh), {material(0.05, 0.2), material(0.1, 0.3)}, Air{});
}

inline std::shared_ptr<const Scene> hall() { return rooms::box(30, 20, 12, rooms::uniform_walls(0.15, 1), 1, Air{}); }

inline EffectScene box_scene() {
  std::array<Material, 6> walls = rooms::uniform_walls(0.2, 0.3);
  return {"box",
          rooms::box(5, 4, 3, walls, 1, Air{}),
          point(1.2, 1.5, 1.1),
          {point(3.8, 2.3, 1.6), point(1.5, 1.5, 1.1), point(4.9, 3.9, 0.1)}};
}
inline EffectScene two_rooms_scene(double door_m, double transmission) {
  return {door_m > 0 ? "two rooms" : "closed rooms",
          two_rooms(9, 4, 3, door_m, material(0.15, 0.4), material(0.15, 0.4, transmission)),
          point(1.5, 1.2, 1.5),
          {point(3, 2.5, 1.5), point(6, 2, 1.5), point(5, 3.5, 1.5), point(8, 0.7, 1.2)}};
}
inline EffectScene apartment_scene() {
  auto scene = std::make_shared<const Scene>(load_scene("house:3,rooms=4,area_m2=55"));
  const AirSample air = sample_air(*scene, 1);
  EffectScene result{"apartment", scene, air.points[air.points.size() / 3], {}};
  for (std::size_t i = 0; i < 12; ++i) result.listeners.push_back(air.points[i * air.points.size() / 12]);
  return result;
}
inline EffectScene open_field_scene() {
  return {"open field", rooms::half_space(0.05, 0.3), point(0, 0, 1.5), {point(2, 0, 1.5), point(20, 5, 1.5)}};
}
inline EffectScene canyon_scene() { return {"canyon", canyon(), point(50, 5, 1.5), {point(60, 7, 1.5), point(80, 3, 1.5)}}; }
inline EffectScene closet_scene() {
  return {"closet", rooms::box(1, 1, 2.4, rooms::uniform_walls(0.02, 0.3), 1, Air{}), point(0.3, 0.4, 1.2), {point(0.7, 0.6, 1.5)}};
}
inline EffectScene hall_scene() { return {"hall", hall(), point(6, 7, 1.5), {point(20, 12, 1.5), point(9, 7, 1.5)}}; }

inline std::vector<EffectScene> all_scenes() {
  return {box_scene(),
          two_rooms_scene(0.9, 0.01),
          two_rooms_scene(0, 0.01),
          apartment_scene(),
          open_field_scene(),
          canyon_scene(),
          closet_scene(),
          hall_scene()};
}

inline EnergyResponse render(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener) {
  EnergyResponse response;
  compute_energy_response(scene, candidates, listener, response);
  return response;
}
inline EnergyResponse render(const std::shared_ptr<const Scene>& scene, const AcousticConfig& config, glm::vec3 source,
                             glm::vec3 listener) {
  const AcousticScene acoustic(scene, config);
  return render(acoustic, EarlyCandidates(acoustic, source), listener);
}

/// Everything of a response as bits; directions and stats do not matter to what is heard and are left out.
inline std::vector<float> bits_of(const EnergyResponse& response) {
  std::vector<float> bits(response.late.values().begin(), response.late.values().end());
  for (const Arrival& arrival : response.arrivals) {
    bits.push_back(static_cast<float>(arrival.kind));
    bits.push_back(arrival.distance_m);
    bits.insert(bits.end(), arrival.amplitude.begin(), arrival.amplitude.end());
    bits.insert(bits.end(), arrival.phase_rad.begin(), arrival.phase_rad.end());
  }
  return bits;
}
inline bool same_bits(const EnergyResponse& a, const EnergyResponse& b) {
  const std::vector<float> x = bits_of(a), y = bits_of(b);
  return x.size() == y.size() && std::memcmp(x.data(), y.data(), x.size() * sizeof(float)) == 0;
}

/// The largest differences over bands.
struct Change {
  double energy_db = 0, edc_db = 0, t30_percent = 0, c80_db = 0, drr_db = 0;
  void add(const Change& other) {
    energy_db = std::max(energy_db, other.energy_db);
    edc_db = std::max(edc_db, other.edc_db);
    t30_percent = std::max(t30_percent, other.t30_percent);
    c80_db = std::max(c80_db, other.c80_db);
    drr_db = std::max(drr_db, other.drr_db);
  }
  [[nodiscard]] double largest_db() const { return std::max({energy_db, edc_db, c80_db, drr_db}); }
};

/// Energy of one band over time, arrivals in the bins they fall into; `bins` of them.
inline std::vector<double> series(const EnergyResponse& response, int band, int bins) {
  std::vector<double> energy(static_cast<std::size_t>(bins), 0.0);
  const std::vector<double> late = response.late.band_energy(band);
  std::copy_n(late.begin(), std::min(late.size(), energy.size()), energy.begin());
  for (const Arrival& arrival : response.arrivals) {
    const auto bin = static_cast<int>(arrival.distance_m / response.speed_of_sound_m_per_s / response.late.bin_s());
    const double amplitude = arrival.amplitude[static_cast<std::size_t>(band)];
    if (bin < bins) energy[static_cast<std::size_t>(bin)] += amplitude * amplitude;
  }
  return energy;
}

inline double db(double ratio) { return 10.0 * std::log10(ratio); }

/// `a` and `b` come from `scene_a` and `scene_b`, which differ in their plans only.  Decay curves, as energy that is left and relative to
/// their start, are compared down to `floor_db`: -45 dB, as far as the plan's budget reaches.
inline Change compare(const AcousticScene& scene_a, const EnergyResponse& a, const AcousticScene& scene_b, const EnergyResponse& b,
                      double floor_db = -45) {
  Change change;
  const int bins = std::max(a.late.num_bins(), b.late.num_bins());
  const RoomMetrics ma = measure(scene_a, a), mb = measure(scene_b, b);
  for (int band = 0; band < scene_a.num_bands(); ++band) {
    const std::vector<double> ea = series(a, band, bins), eb = series(b, band, bins);
    std::vector<double> edc_a(ea.size()), edc_b(eb.size());
    energy_decay_curve(ea, edc_a);
    energy_decay_curve(eb, edc_b);
    if (edc_a[0] == 0 && edc_b[0] == 0) continue;
    if (edc_a[0] == 0 || edc_b[0] == 0) {
      change.energy_db = change.edc_db = std::numeric_limits<double>::infinity();
      continue;
    }
    change.energy_db = std::max(change.energy_db, std::abs(db(edc_a[0] / edc_b[0])));
    const double start_db = db(edc_a[0] / edc_b[0]);
    for (std::size_t i = 0; i < edc_a.size(); ++i) {
      // Until both are below the floor: a curve that ends early must not end the comparison.
      if (std::max(db(edc_a[i] / edc_a[0]), db(edc_b[i] / edc_b[0])) < floor_db) break;
      const double left_db = std::abs(db(edc_a[i] / edc_b[i]));  // infinite where one of them has ended
      change.edc_db = std::max({change.edc_db, left_db, std::abs(db(edc_a[i] / edc_b[i]) - start_db)});
    }
    const BandMetrics &x = ma.bands[static_cast<std::size_t>(band)], &y = mb.bands[static_cast<std::size_t>(band)];
    if (x.t30_s && y.t30_s) change.t30_percent = std::max(change.t30_percent, 100 * std::abs(*x.t30_s / *y.t30_s - 1));
    if (x.c80_db && y.c80_db) change.c80_db = std::max(change.c80_db, std::abs(*x.c80_db - *y.c80_db));
    if (x.drr_db && y.drr_db) change.drr_db = std::max(change.drr_db, std::abs(*x.drr_db - *y.drr_db));
  }
  return change;
}

inline const EffectDecision* decision(const AcousticScene& scene, const std::string& effect) {
  for (const EffectDecision& d : scene.plan().decisions)
    if (d.effect == effect) return &d;
  return nullptr;
}

}  // namespace earshot::effects
