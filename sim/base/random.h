// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace earshot {

/// Purpose of a random number.  Two purposes never share numbers, so a new consumer does not shift an old one.
/// Append only: the value is part of the random key, and files promise the same bits.
enum class Purpose : std::uint32_t {
  test = 0,
  listener_ray = 1,
  source_ray = 2,
  scatter = 3,
  roulette = 4,
  carrier = 5,
  house = 6,
  episode = 7,
  episode_order = 8,
  action = 9,
  weights = 10,
  minibatch = 11,
  sound = 12,
  random_agent = 13,
  material = 14,
  ray_efficiency = 15,
  photon = 16,
  photon_roulette = 17,
  field_probe = 18,
  effect_plan = 19,
  bench = 20,
  surface_sample = 21,
  calibration = 22,
  depth_noise = 23,
  pose_noise = 24,
  actuation_noise = 25,
  bootstrap = 26,
  oracle_episode = 27,
  source_sphere = 28,
  late_edges = 29,
};

/// Philox4x32-10 (Salmon et al. 2011, "Parallel random numbers: as easy as 1, 2, 3", section 3.3).
/// A pure function: four words of counter and two of key give four random words.
std::array<std::uint32_t, 4> philox4x32(std::array<std::uint32_t, 4> counter, std::array<std::uint32_t, 2> key);

/// Random numbers as a function of (seed, purpose, a, b, c, draw): no state, so threads, batches and order cannot change
/// a result.  a, b, c identify the consumer (env, step, ray; or vertex, bounce, ...); `draw` counts its numbers.
class RandomStream {
 public:
  RandomStream(std::uint64_t seed, Purpose purpose, std::uint32_t a = 0, std::uint32_t b = 0, std::uint32_t c = 0);

  [[nodiscard]] std::array<std::uint32_t, 4> bits4(std::uint32_t draw) const { return philox4x32({a_, b_, c_, draw}, key_); }
  [[nodiscard]] std::uint32_t bits(std::uint32_t draw) const { return bits4(draw)[0]; }
  /// Uniform in [0, 1): 24 bits, exactly representable, so the same on every machine.
  [[nodiscard]] float uniform(std::uint32_t draw) const { return to_unit(bits4(draw)[0]); }
  [[nodiscard]] std::array<float, 2> uniform2(std::uint32_t draw) const;
  [[nodiscard]] std::array<float, 4> uniform4(std::uint32_t draw) const;
  /// Uniform integer in [0, count), count > 0.  Multiply-shift: bias below count / 2^32.
  [[nodiscard]] std::uint32_t below(std::uint32_t count, std::uint32_t draw) const;
  /// Two independent standard normal numbers (Box and Muller 1958).
  [[nodiscard]] std::array<float, 2> normal2(std::uint32_t draw) const;

  [[nodiscard]] static constexpr float to_unit(std::uint32_t word) { return static_cast<float>(word >> 8) * (1.0f / 16777216.0f); }

 private:
  std::array<std::uint32_t, 2> key_;
  std::uint32_t a_, b_, c_;
};

}  // namespace earshot
