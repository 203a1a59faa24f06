// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/photon_pass.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "sim/acoustics/core/band_sum.h"
#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/source_field/photon_rooms.h"
#include "sim/acoustics/tracers/listener_ray.h"
#include "sim/acoustics/tracers/population_control.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

using listener_ray::RayState;
using listener_ray::Trace;

/// A photon under way.
template <int W>
struct Photon : RayState<W> {
  std::uint32_t cell = FieldGrid::no_cell;  ///< that holds its origin; no_cell if unknown
  std::uint32_t room = FieldGrid::no_room;  ///< that it was seen in last
  std::uint64_t visited = 0;                ///< rooms that it has been in (PhotonRooms::bit_of)
};
template <int W>
using Rooms = PhotonRooms<W, Photon<W>>;

/// Do image paths, flutter echoes, or what goes straight through walls, carry the next segment of the photon?  Its chain lists the mirrors
/// source first.
template <int W>
bool carried_elsewhere(const Trace& trace, const RayState<W>& photon) {
  if (photon.bounces == 0 || photon.only_walls) return true;
  if (!photon.all_specular) return false;
  if (photon.chain_length > trace.carried_order)
    return trace.candidates.long_chains() && trace.candidates.long_chains()->carries_from_source(photon.long_chain);
  return trace.candidates.contains(std::span(photon.chain.data(), static_cast<std::size_t>(photon.chain_length)));
}

/// Follows a photon until it has gone `until_m` and stands at a surface, or ends.  rooms: null where there is one at most, or no sound goes
/// through walls.
template <int W>
void advance(const Trace& trace, const FieldGrid& grid, Rooms<W>* rooms, Photon<W>& photon, float until_m, const RandomStream& random,
             PhotonTracks& tracks, TraceStats& stats) {
  const AcousticScene& scene = trace.scene;
  while (true) {
    if (photon.at_vertex) {
      if (photon.path_m >= until_m) return;
      const glm::vec3 before = photon.direction;
      const std::uint32_t wall = scene.scene().mesh().triangle_material[photon.hit.triangle];
      const bool stays = rooms != nullptr && trace.walls->transmits(wall) && rooms->part(photon, wall);
      listener_ray::leave_vertex<W>(trace, photon, random, stats, stays);
      if (!photon.alive) return;
      if (photon.direction == before) photon.cell = FieldGrid::no_cell;  // through a wall
    }
    const Hit hit = scene.scene().rays().intersect(photon.origin, photon.direction);
    ++(hit.valid() ? stats.ray_hits : stats.ray_escapes);
    const float length_m = std::min(hit.distance_m, trace.max_path_m - photon.path_m);
    if (!carried_elsewhere<W>(trace, photon)) {
      if (std::isfinite(sum_over_bands<W>(photon.throughput))) {
        const auto first = static_cast<std::uint32_t>(tracks.crossings.size());
        photon.cell = grid.cross(photon.origin, photon.direction, length_m, tracks.crossings, photon.cell);
        if (rooms != nullptr) rooms->note(photon);
        tracks.segments.push_back({photon.direction, photon.path_m, first, static_cast<std::uint32_t>(tracks.crossings.size())});
        tracks.energy.insert(tracks.energy.end(), photon.throughput, photon.throughput + W);
      } else {
        ++stats.nonfinite_dropped;
        photon.alive = false;
        return;
      }
    } else {
      photon.cell = FieldGrid::no_cell;
    }
    photon.path_m += hit.distance_m;
    photon.alive = hit.valid() && photon.bounces < trace.max_bounces && photon.path_m < trace.max_path_m;
    if (!photon.alive) return;
    const std::uint32_t material = scene.scene().mesh().triangle_material[hit.triangle];
    const float* reflected = trace.walls ? trace.walls->kept(material) : scene.padded_reflectance(material);
    for (int b = 0; b < W; ++b) photon.reflected[b] = photon.throughput[b] * reflected[b];
    photon.hit = hit;
    photon.origin = offset_from_surface(hit.position, hit.normal);
    photon.at_vertex = true;
    ++photon.bounces;
  }
}

/// Photon number i of a chunk as it leaves the source.
template <int W>
Photon<W> start_photon(const Trace& trace, std::uint32_t i, TraceStats& stats) {
  const auto num_bands = static_cast<std::size_t>(trace.scene.num_bands());
  Photon<W> photon;
  photon.direction = trace.directions.direction(i);
  photon.origin = trace.source;
  if (trace.source_spread_m > 0) {
    const auto u = RandomStream(trace.scene.config().seed, Purpose::photon, i).uniform4(0);
    photon.origin = point_in_sphere(trace.source, trace.source_spread_m, u[0], u[1], u[2]);
  }
  photon.only_walls = trace.walls != nullptr;
  for (std::size_t b = 0; b < W; ++b) photon.throughput[b] = photon.weight[b] = b < num_bands ? 1.f : 0.f;
  if (trace.emission) trace.emission->energy(photon.direction, std::span<float>(photon.throughput).first(num_bands));
  listener_ray::end_if_spent<W>(photon, stats);  // a pattern may be silent there, or loud beyond floats
  return photon;
}

template <int W>
void trace_one_room(const Trace& trace, const FieldGrid& grid, std::uint32_t chunk, PhotonTracks& tracks, TraceStats& stats) {
  const std::uint64_t seed = trace.scene.config().seed;
  const std::uint32_t first = chunk * kPhotonsPerChunk;
  std::array<Photon<W>, kPhotonsPerChunk> photons;
  for (std::uint32_t i = 0; i < kPhotonsPerChunk; ++i) photons[i] = start_photon<W>(trace, first + i, stats);
  for (std::uint32_t stage = 0;; ++stage) {
    const float until_m = static_cast<float>(stage + 1) * trace.stage_m;
    bool any_alive = false;
    for (std::uint32_t i = 0; i < kPhotonsPerChunk; ++i) {
      if (!photons[i].alive) continue;
      // Random numbers belong to the index and the stage, whichever photon lies there.
      advance<W>(trace, grid, nullptr, photons[i], until_m, RandomStream(seed, Purpose::photon, first + i, stage + 1), tracks, stats);
      any_alive = any_alive || photons[i].alive;
    }
    if (!any_alive) return;
    stats.nonfinite_dropped += static_cast<std::uint64_t>(
        control_population<W>(trace.scene.num_bands(), std::span<Photon<W>>(photons),
                              RandomStream(seed, Purpose::photon_roulette, chunk, stage).uniform(0), kPhotonTaper, kPhotonUneven));
  }
}

/// The room of the source: that of the heaviest cell round it.  no_room outside all rooms, where the nearest cells are behind a wall.
std::uint32_t room_at(const FieldGrid& grid, glm::vec3 point) {
  std::array<FieldGrid::CellWeight, 8> shares;
  const auto cells = std::span(shares).first(grid.blend(point, shares));
  const auto heaviest = std::ranges::max_element(cells, {}, &FieldGrid::CellWeight::weight);
  if (heaviest == cells.end() || !grid.visible_from(heaviest->cell, point)) return FieldGrid::no_room;
  return grid.room(heaviest->cell);
}

template <int W>
void trace_rooms(const Trace& trace, const FieldGrid& grid, std::uint32_t source_room, std::uint32_t chunk, PhotonTracks& tracks,
                 TraceStats& stats) {
  const std::uint64_t seed = trace.scene.config().seed;
  const std::uint32_t first = chunk * kPhotonsPerChunk;
  Rooms<W> rooms(trace, grid, source_room, kPhotonsPerChunk);
  std::vector<Photon<W>> photons;
  for (std::uint32_t i = 0; i < kPhotonsPerChunk; ++i) {
    photons.push_back(start_photon<W>(trace, first + i, stats));
    photons.back().room = source_room;
    if (source_room != FieldGrid::no_room) photons.back().visited = Rooms<W>::bit_of(source_room);
  }
  for (std::uint32_t stage = 0; !photons.empty(); ++stage) {
    const float until_m = static_cast<float>(stage + 1) * trace.stage_m;
    for (std::size_t done = 0; done < photons.size();) {
      for (; done < photons.size(); ++done) {
        if (!photons[done].alive) continue;
        // Beyond the chunk's own indices the third word tells its photons from those of the next chunk.
        const auto slot = static_cast<std::uint32_t>(done);
        const RandomStream random(seed, Purpose::photon, first + slot % kPhotonsPerChunk, stage + 1, slot / kPhotonsPerChunk);
        advance<W>(trace, grid, &rooms, photons[done], until_m, random, tracks, stats);
      }
      const std::vector<Photon<W>> entered = rooms.take_entered();
      photons.insert(photons.end(), entered.begin(), entered.end());
    }
    stats.nonfinite_dropped += static_cast<std::uint64_t>(rooms.control(
        photons, [&](std::uint32_t room) { return RandomStream(seed, Purpose::photon_roulette, chunk, stage, room).uniform(0); }));
  }
}

/// Is there a room behind walls, where a listener may be?  The inside of a wardrobe is none (PhotonRooms).
bool has_rooms_behind_walls(const FieldGrid& grid, std::uint32_t source_room) {
  for (std::uint32_t room = 0; room < grid.num_rooms(); ++room)
    if (room != source_room && !grid.inside_body(room)) return true;
  return false;
}

template <int W>
void trace_chunk(const Trace& trace, const FieldGrid& grid, std::uint32_t chunk, PhotonTracks& tracks, TraceStats& stats) {
  const std::uint32_t source_room = trace.walls != nullptr ? room_at(grid, trace.source) : FieldGrid::no_room;
  if (trace.walls != nullptr && has_rooms_behind_walls(grid, source_room))
    trace_rooms<W>(trace, grid, source_room, chunk, tracks, stats);
  else
    trace_one_room<W>(trace, grid, chunk, tracks, stats);
}

}  // namespace

void trace_photons(const AcousticScene& scene, const EarlyCandidates& candidates, const FieldGrid& grid, std::uint32_t chunk,
                   PhotonTracks& tracks, TraceStats& stats) {
  tracks.clear();
  const AcousticConfig& config = scene.config();
  const auto shift = RandomStream(config.seed, Purpose::photon).bits4(0);
  const Trace trace{.scene = scene,
                    .candidates = candidates,
                    .emission = candidates.emission().omnidirectional() ? nullptr : &candidates.emission(),
                    .walls = traces_transmission(scene) ? &scene.reflection_model() : nullptr,
                    .source = candidates.source(),
                    .listener = {},
                    .directions = {shift[0], shift[1]},
                    .num_rays = kPhotonsPerChunk,
                    .max_bounces = config.max_bounces,
                    .carried_order = scene.image_order(),
                    .sh_order = config.sh_order,
                    .num_coefficients = 0,
                    .weight_per_ray = 1,
                    .max_path_m = scene.max_path_m(),
                    .seconds_per_m = 1.f / scene.speed_of_sound_m_per_s(),
                    .stage_m = std::max(kStageOfDiagonal * scene.diagonal_m(), 1e-4f * scene.max_path_m()),
                    .least_distance2_m2 = 0,
                    .source_radius_m = 1,  // photons go on behind the last mirror
                    .source_spread_m = candidates.sound_source().radius_m,
                    .diffuse_last_segment = false};
  using TraceChunk = void (*)(const Trace&, const FieldGrid&, std::uint32_t, PhotonTracks&, TraceStats&);
  constexpr TraceChunk by_width[] = {trace_chunk<8>, trace_chunk<16>, trace_chunk<24>, trace_chunk<32>};
  static_assert(kMaxBands == 32);
  by_width[scene.padded_bands() / 8 - 1](trace, grid, chunk, tracks, stats);
}

}  // namespace earshot
