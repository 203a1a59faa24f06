// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/transforms/fft.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/files/test_data.h"

/// The measured room of dEchorate (Di Carlo et al. 2021, EURASIP J. Audio Speech Music Process. 39), code 011111: its geometry, its
/// annotations, and decay and DRR of its impulse responses.  None of it
/// is the product's code but the FFT and the reader of WAV files.
namespace earshot::measured_room {

/// Walls in the order of the file.
inline constexpr std::array<const char*, 6> kWalls{"west", "east", "south", "north", "floor", "ceiling"};
inline constexpr int kSouth = 2;  ///< its annotation is unreliable, as the file says

struct Microphone {
  std::string file;
  std::array<double, 3> position_m;
  double direct_s;
  std::array<double, 6> reflection_s;
};

struct Room {
  std::filesystem::path folder;
  std::array<double, 6> wall_m;  ///< where the planes are: fitted by the file's authors where they give it, else as measured
  std::array<double, 3> source_m;
  std::vector<Microphone> microphones;
  double speed_of_sound_m_per_s, temperature_c, humidity_percent;
};

/// nullopt where the data is absent.
inline std::optional<Room> load() {
  Room room;
  room.folder = data_folder() / "rir" / "dechorate";
  std::ifstream file(room.folder / "dechorate_011111.json");
  if (!file) return std::nullopt;
  const nlohmann::json json = nlohmann::json::parse(file);
  const std::array<double, 3> size_m = json.at("room_size_m");
  room.wall_m = {0, size_m[0], 0, size_m[1], 0, size_m[2]};
  for (std::size_t wall = 0; wall < 6; ++wall) {
    if (json.at("fitted_wall_planes_m").contains(kWalls[wall])) room.wall_m[wall] = json.at("fitted_wall_planes_m").at(kWalls[wall]);
  }
  room.source_m = json.at("source");
  room.speed_of_sound_m_per_s = json.at("speed_of_sound");
  room.temperature_c = json.at("temperature_C");
  room.humidity_percent = json.at("humidity_pct");
  for (const nlohmann::json& mic : json.at("mics")) {
    room.microphones.push_back({mic.at("file"), mic.at("pos"), mic.at("toa_direct_s"), mic.at("toa_first_order_s")});
  }
  return room;
}

/// Its walls as a box for the engine, materials in the order of kWalls; the corner of west, south and floor is the origin.
inline std::shared_ptr<const Scene> scene_of(const Room& room, const std::array<Material, 6>& walls) {
  Air air;
  air.temperature_c = static_cast<float>(room.temperature_c);
  air.humidity_percent = static_cast<float>(room.humidity_percent);
  air.speed_of_sound_m_per_s = static_cast<float>(room.speed_of_sound_m_per_s);
  const std::array<double, 6>& at = room.wall_m;
  return rooms::box(at[1] - at[0], at[3] - at[2], at[5] - at[4], walls, 1, air);
}
inline glm::vec3 point_in(const Room& room, const std::array<double, 3>& position_m) {
  return rooms::point(position_m[0] - room.wall_m[0], position_m[1] - room.wall_m[2], position_m[2] - room.wall_m[4]);
}

/// Decay of one octave.
struct DecayTime {
  double t20_s = 0;
  double cut_s = 0;     ///< where the integration ended
  double floor_db = 0;  ///< of the last 20 ms, below the loudest
};

inline constexpr double kDirectWindowS = 2.5e-3;
inline constexpr double kBlockS = 1e-3;
inline constexpr double kEarlyS = 0.05;  ///< of C50

/// Squared output of a zero-phase octave filter (raised-cosine edges half an octave wide in log frequency) in blocks of 1 ms, from
/// `start_s` on.
inline std::vector<double> octave_energy(std::span<const float> samples, double rate_hz, double centre_hz, double start_s) {
  const int size = next_power_of_two(static_cast<int>(2 * samples.size()));
  RealFft fft(size);
  std::vector<std::complex<float>> spectrum(fft.num_bins());
  fft.forward(samples, spectrum);
  for (int k = 0; k < fft.num_bins(); ++k) {
    const double octaves = k == 0 ? 1e3 : std::fabs(std::log2(k * rate_hz / size / centre_hz));
    const double x = std::clamp((0.75 - octaves) / 0.5, 0.0, 1.0);
    spectrum[k] *= static_cast<float>(std::sin(0.5 * std::numbers::pi * x));
  }
  std::vector<float> filtered(size);
  fft.inverse(spectrum, filtered);
  std::vector<double> blocks;
  for (double begin_s = start_s;; begin_s += kBlockS) {
    const auto begin = static_cast<std::size_t>(std::lround(begin_s * rate_hz)),
               end = static_cast<std::size_t>(std::lround((begin_s + kBlockS) * rate_hz));
    if (end > samples.size()) return blocks;
    double sum = 0;
    for (std::size_t i = begin; i < end; ++i) sum += double{filtered[i]} * filtered[i];
    blocks.push_back(sum);
  }
}

/// Least squares of the decay curve (dB, one point per block) between -5 and -25 dB.  `tail`: energy that follows the last block.
inline double fit_t20_s(std::span<const double> blocks, double tail) {
  std::vector<double> left(blocks.size());
  double sum = tail;
  for (std::size_t i = blocks.size(); i-- > 0;) left[i] = sum += blocks[i];
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t i = 0; i < left.size(); ++i) {
    const double level_db = 10 * std::log10(left[i] / left[0]), t_s = static_cast<double>(i) * kBlockS;
    if (level_db > -5 || level_db < -25) continue;
    n += 1, x += t_s, y += level_db, xx += t_s * t_s, xy += t_s * level_db;
  }
  return n < 3 ? std::nan("") : -60 * (n * xx - x * x) / (n * xy - x * y);
}

/// Decay freed of noise and of the end of the record: the integral stops where the level, smoothed over 20 ms, has come down 35 dB from its
/// maximum (the floor of these records lies deeper), or at the end, and what an exponential of the fitted decay holds behind is
/// added (ISO 3382-1, 5.3.3).  blocks: 1 ms each, from the direct sound on.
inline DecayTime measure_decay(std::span<const double> blocks) {
  constexpr std::size_t width = 20;
  std::vector<double> level(blocks.size() - width + 1, 0.0);  // energy of 20 blocks from each on
  for (std::size_t i = 0; i < level.size(); ++i) {
    for (std::size_t k = 0; k < width; ++k) level[i] += blocks[i + k];
  }
  const double loudest = *std::max_element(level.begin(), level.end());
  const auto below = std::find_if(level.begin(), level.end(), [&](double energy) { return energy < loudest * std::pow(10, -3.5); });
  const std::size_t count = below == level.end() ? blocks.size() : static_cast<std::size_t>(below - level.begin()) + width / 2;
  DecayTime result{.t20_s = 0.4, .cut_s = static_cast<double>(count) * kBlockS, .floor_db = 10 * std::log10(level.back() / loudest)};
  for (int pass = 0; pass < 10; ++pass) {
    // Energy behind the cut over that of the last 20 ms before it, for a decay exp(-rate t).
    const double rate = 6 * std::numbers::ln10 / result.t20_s;
    const double tail = level[count - width] / std::expm1(rate * width * kBlockS);
    result.t20_s = fit_t20_s(blocks.first(count), tail);
  }
  return result;
}

/// Direct-to-reverberant ratio of one octave: what lies within 2.5 ms of the direct sound, filtered apart from the rest.
inline double measure_drr_db(std::span<const float> samples, double rate_hz, double centre_hz, double direct_s) {
  std::vector<float> direct(samples.size(), 0.f), rest(samples.begin(), samples.end());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (std::fabs(static_cast<double>(i) / rate_hz - direct_s) < kDirectWindowS) std::swap(direct[i], rest[i]);
  }
  const auto energy = [&](const std::vector<float>& part) {
    double sum = 0;
    for (const double block : octave_energy(part, rate_hz, centre_hz, 0)) sum += block;
    return sum;
  };
  return 10 * std::log10(energy(direct) / energy(rest));
}

/// Clarity C50 of one octave: what comes within 50 ms of the direct sound over what comes later, up to where measure_decay() stops.  The
/// filter spreads the direct sound over 3 ms either side, all of which counts as early.
inline double measure_c50_db(std::span<const float> samples, double rate_hz, double centre_hz, double direct_s) {
  constexpr double before_s = 0.003;
  const std::vector<double> blocks = octave_energy(samples, rate_hz, centre_hz, direct_s - before_s);
  const DecayTime decay = measure_decay(octave_energy(samples, rate_hz, centre_hz, direct_s));
  const auto limit = static_cast<std::size_t>(std::lround((before_s + kEarlyS) / kBlockS)),
             end = static_cast<std::size_t>(std::lround((before_s + decay.cut_s) / kBlockS));
  double early = 0, late = 0;
  for (std::size_t i = 0; i < std::min(end, blocks.size()); ++i) (i < limit ? early : late) += blocks[i];
  return 10 * std::log10(early / late);
}

}  // namespace earshot::measured_room
