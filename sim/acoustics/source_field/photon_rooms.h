// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "sim/acoustics/core/band_sum.h"
#include "sim/acoustics/geometry/field_grid.h"
#include "sim/acoustics/model/wall_crossing.h"
#include "sim/acoustics/tracers/listener_ray.h"
#include "sim/acoustics/tracers/population_control.h"

namespace earshot {

/// Mean energy, relative to the start, below which the number of photons falls with it, and the fraction of that number that uneven weights
/// are worth below which they are resampled.  They serve all listeners, and T20 ends at -25 dB.  Against 1e-2 and 0.7 the spread of T20
/// over 16 to 24 seeds falls by 16 % in the large house of the benchmarks, 13 % in house:1 and 15 % in a shoebox, for 19 % more rays; 1e-3
/// takes 14 % more rays yet for 3 % less.
inline constexpr double kPhotonTaper = 3e-3, kPhotonUneven = 0.85;

/// Photons of a chunk in a scene of several rooms with walls between them that let sound through.
///
/// One photon in two thousand goes through drywall.  What goes through by chance gives a room behind it a few photons, or none, and the
/// weighing of photons against each other (population_control.h) ends these few, as light as they are.  So a photon that meets a wall to a
/// room that it has never been in is parted: one half stays with what the wall keeps, the other goes through with the rest (importance
/// splitting, Kahn and Harris 1951).  The photons of each room are weighed against those of this room alone, and come to the same number in
/// every room, whatever the wall leaves of them.  No mean changes.  Back through a wall, into a wardrobe, and where a wall has one room on
/// both sides, they go by chance.
template <int W, class Photon>
class PhotonRooms {
 public:
  /// source_room: the one that all photons start in; FieldGrid::no_room if that is not known.
  PhotonRooms(const listener_ray::Trace& trace, const FieldGrid& grid, std::uint32_t source_room, std::uint32_t photons)
      : trace_(trace), grid_(grid), source_room_(source_room), photons_(photons), peak_(grid.num_rooms() + 1, 0.0), groups_(peak_.size()) {
    peak_[index_of(source_room)] = photons;
    std::uint32_t behind = 0;
    for (std::uint32_t room = 0; room < grid.num_rooms(); ++room) {
      if (!counts(room)) continue;
      all_rooms_ |= bit_of(room);
      if (room != source_room) ++behind;
    }
    photons_behind_ = std::clamp(kPhotonsBehind / std::max(behind, 1u), kLeastBehind, photons);
  }

  /// If the wall at which the photon waits leads to a room where it has not been, parts it and keeps the half that goes through.  Returns
  /// whether it did: the photon then stays in its room.
  bool part(Photon& photon, std::uint32_t material) {
    if (entered_.size() >= kMostEntered || (photon.visited & all_rooms_) == all_rooms_) return false;
    if (photon.room == FieldGrid::no_room && photon.visited != 0) return false;
    const std::uint32_t room = room_beyond(photon);
    if (room == FieldGrid::no_room || room == photon.room || (photon.visited & bit_of(room)) != 0) return false;
    Photon through = listener_ray::part_at_wall<W>(trace_, photon, material);
    const float total = sum_over_bands<W>(through.throughput);
    if (!(total > 0) || !std::isfinite(total)) return true;
    through.visited |= bit_of(room);
    through.room = room;
    through.cell = FieldGrid::no_cell;
    entered_.push_back(through);
    return true;
  }
  /// Notes the room that a photon has come to.
  void note(Photon& photon) const {
    const std::uint32_t room = photon.cell < FieldGrid::gap ? room_of(photon.cell) : FieldGrid::no_room;
    if (room == FieldGrid::no_room) return;
    photon.room = room;
    photon.visited |= bit_of(room);
  }
  /// Halves that have gone through walls since the last call, in the order in which they did.
  std::vector<Photon> take_entered() { return std::exchange(entered_, {}); }

  /// Weighs the photons of each room against each other; those that remain are in the order of their rooms.  random(room): uniform in
  /// [0, 1).  Returns how many were ended because their energy was not finite.
  template <class Random>
  int control(std::vector<Photon>& photons, const Random& random) {
    for (std::vector<Photon>& group : groups_) group.clear();
    int nonfinite = 0;
    for (const Photon& photon : photons) {
      if (!photon.alive) continue;
      if (std::isfinite(sum_over_bands<W>(photon.reflected)))
        groups_[index_of(photon.room)].push_back(photon);
      else
        ++nonfinite;
    }
    photons.clear();
    for (std::uint32_t room = 0; room < groups_.size(); ++room) {
      std::vector<Photon>& group = groups_[room];
      if (group.empty()) continue;
      const double full = room == index_of(source_room_) ? photons_ : photons_behind_;
      control_group<W>(trace_.scene.num_bands(), group, full, peak_[room], random(room), kPhotonTaper, kPhotonUneven);
      photons.insert(photons.end(), group.begin(), group.end());
    }
    return nonfinite;
  }

  /// Rooms 64 apart share a bit: photons go from one to the other by chance.
  static std::uint64_t bit_of(std::uint32_t room) { return std::uint64_t{1} << (room % 64); }

 private:
  /// All rooms but that of the source share so many photons of each chunk, but each has the lesser number.
  static constexpr std::uint32_t kPhotonsBehind = 128, kLeastBehind = 16;
  /// Parted photons of a chunk and stage; all others go by chance.
  static constexpr std::size_t kMostEntered = 2048;

  [[nodiscard]] std::size_t index_of(std::uint32_t room) const { return std::min<std::size_t>(room, grid_.num_rooms()); }

  /// The insides of bodies do not, but for that of the source: they are small and hard, and photons that bounce in there would take several
  /// times the work of the rooms.  Sound goes through a wall of two faces in one step (wall_crossing.h).
  [[nodiscard]] bool counts(std::uint32_t room) const { return room == source_room_ || !grid_.inside_body(room); }
  [[nodiscard]] std::uint32_t room_of(std::uint32_t cell) const {
    const std::uint32_t room = grid_.room(cell);
    return room != FieldGrid::no_room && counts(room) ? room : FieldGrid::no_room;
  }

  [[nodiscard]] std::uint32_t room_beyond(const Photon& photon) {
    const WallCrossing crossing = cross_wall(trace_.scene.surfaces(), photon.direction, photon.hit);
    const Hit hit = trace_.scene.scene().rays().intersect(crossing.exit, photon.direction);
    if (!hit.valid()) return FieldGrid::no_room;  // into the open, as through outer walls: by chance
    crossings_.clear();
    grid_.cross(crossing.exit, photon.direction, std::min(hit.distance_m, trace_.max_path_m), crossings_);
    for (const FieldGrid::Crossing& part : crossings_)
      if (room_of(part.cell) != FieldGrid::no_room) return room_of(part.cell);
    return FieldGrid::no_room;
  }

  const listener_ray::Trace& trace_;
  const FieldGrid& grid_;
  std::uint32_t source_room_, photons_, photons_behind_ = 0;
  std::uint64_t all_rooms_ = 0;              ///< bits of every room: a photon that has them all is in no need of a way
  std::vector<double> peak_;                 ///< [rooms, and one for all other air] largest energy so far of the loudest band
  std::vector<std::vector<Photon>> groups_;  ///< of the same
  std::vector<Photon> entered_;
  std::vector<FieldGrid::Crossing> crossings_;
};

}  // namespace earshot
