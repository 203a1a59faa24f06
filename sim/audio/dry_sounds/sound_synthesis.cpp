// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>
#include <string_view>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr float kPeak = 0.5f;

/// Seeded choices in the order of the calls.
class Dice {
 public:
  Dice(std::uint64_t seed, std::uint32_t kind) : random_(seed, Purpose::sound, kind) {}
  double between(double low, double high) { return low + (high - low) * static_cast<double>(random_.uniform(draw_++)); }
  int count(int low, int high) { return low + static_cast<int>(random_.below(static_cast<std::uint32_t>(high - low + 1), draw_++)); }
  bool chance(double probability) { return between(0, 1) < probability; }

 private:
  RandomStream random_;
  std::uint32_t draw_ = 0;
};

/// A loop buffer: samples past the end continue at the beginning, so the loop has no seam.
class Loop {
 public:
  Loop(double length_s, double rate_hz, std::uint64_t seed, std::uint32_t kind)
      : rate_hz_(rate_hz),
        samples_(static_cast<std::size_t>(std::lround(length_s * rate_hz)), 0.0),
        noise_(seed, Purpose::sound, kind, 1) {}

  [[nodiscard]] double rate_hz() const { return rate_hz_; }
  [[nodiscard]] double length_s() const { return static_cast<double>(samples_.size()) / rate_hz_; }
  [[nodiscard]] std::vector<double>& samples() { return samples_; }
  /// The nearest frequency with a whole number of periods in the loop.
  [[nodiscard]] double periodic(double frequency_hz) const { return std::max(1.0, std::round(frequency_hz * length_s())) / length_s(); }
  /// Partials above this would alias or ring at the edge of the resampler.
  [[nodiscard]] double highest_hz() const { return 0.45 * rate_hz_; }
  /// Gaussian noise of unit variance for stream sample `index`.
  [[nodiscard]] double noise(std::size_t index) const { return noise_.normal2(static_cast<std::uint32_t>(index))[0]; }

  /// Adds sound(t) for t in [0, duration_s), placed at start_s.
  template <class Sound>
  void add(double start_s, double duration_s, Sound&& sound) {
    const auto first = static_cast<std::size_t>(std::lround(start_s * rate_hz_));
    const auto count = static_cast<std::size_t>(std::ceil(duration_s * rate_hz_));
    for (std::size_t i = 0; i < count; ++i) samples_[(first + i) % samples_.size()] += sound(static_cast<double>(i) / rate_hz_);
  }
  /// A noise burst with its own envelope, sharpened by a first difference.
  template <class Envelope>
  void add_hiss(double start_s, double duration_s, Envelope&& envelope) {
    std::size_t index = static_cast<std::size_t>(std::lround(start_s * rate_hz_));
    add(start_s, duration_s, [&](double t) {
      ++index;
      return envelope(t) * (noise(index) - 0.9 * noise(index - 1));
    });
  }

 private:
  double rate_hz_;
  std::vector<double> samples_;
  RandomStream noise_;
};

/// Rises within `attack_s`, then falls by a factor e every `decay_s`.
double pluck(double t, double attack_s, double decay_s) { return std::min(t / attack_s, 1.0) * std::exp(-t / decay_s); }
/// One arch of a squared sine.
double arch(double t, double duration_s) {
  const double s = std::sin(std::numbers::pi * std::clamp(t / duration_s, 0.0, 1.0));
  return s * s;
}

/// An electromechanical bell: a clapper between two gongs, in one or two bursts.
void telephone(Loop& loop, Dice& dice) {
  const double gong_hz[2] = {dice.between(420, 900), dice.between(950, 1400)};
  const double strikes_hz = dice.between(18, 27);
  const int bursts = dice.count(1, 2);
  const double burst_s = loop.length_s() / bursts * dice.between(0.5, 0.7);
  constexpr std::array<double, 5> partial = {1.0, 2.76, 5.40, 8.93, 13.34};  // modes of a free bar
  for (int burst = 0; burst < bursts; ++burst) {
    for (int strike = 0; strike < static_cast<int>(burst_s * strikes_hz); ++strike) {
      const double start = burst * loop.length_s() / bursts + strike / strikes_hz;
      for (std::size_t p = 0; p < partial.size(); ++p) {
        const double frequency = gong_hz[strike % 2] * partial[p];
        if (frequency > loop.highest_hz()) break;
        const double level = 1.0 / (1.0 + static_cast<double>(p));
        loop.add(start, 0.4, [=](double t) {
          return level * pluck(t, 4e-4, 0.09 / (1.0 + 0.5 * static_cast<double>(p))) * std::sin(kTwoPi * frequency * t);
        });
      }
      loop.add_hiss(start, 0.02, [](double t) { return 0.25 * pluck(t, 2e-4, 0.002); });
    }
  }
}

/// A siren: a rich tone whose pitch swings, or that is cut into beeps.
void alarm(Loop& loop, Dice& dice) {
  const double centre_hz = loop.periodic(dice.between(550, 1100));
  const double swing_hz = centre_hz * dice.between(0.15, 0.4);
  const double swings_hz = loop.periodic(dice.between(1, 6));
  const double beeps_hz = dice.chance(0.5) ? loop.periodic(dice.between(2, 5)) : 0.0;
  const int harmonics = std::min(16, static_cast<int>(loop.highest_hz() / (centre_hz + swing_hz)));
  loop.add(0, loop.length_s() - 0.5 / loop.rate_hz(), [&](double t) {
    const double phase = kTwoPi * centre_hz * t - swing_hz / swings_hz * std::cos(kTwoPi * swings_hz * t);
    double value = 0;
    for (int k = 1; k <= harmonics; ++k) value += std::sin(k * phase) / k;
    // A smooth gate: open for about half of each period.
    const double gate = beeps_hz > 0 ? 1.0 / (1.0 + std::exp(-12.0 * std::sin(kTwoPi * beeps_hz * t))) : 1.0;
    return value * gate;
  });
}

/// A plucked melody on a pentatonic scale with a bass and a shaker.
void music(Loop& loop, Dice& dice) {
  constexpr std::array<double, 5> scale = {1.0, 9.0 / 8.0, 5.0 / 4.0, 3.0 / 2.0, 5.0 / 3.0};
  const double root_hz = dice.between(180, 330);
  const int beats = dice.count(8, 16);
  const double beat_s = loop.length_s() / beats;
  const double decay_s = dice.between(0.12, 0.35);
  for (int beat = 0; beat < beats; ++beat) {
    loop.add_hiss(beat * beat_s, 0.06, [&](double t) { return 0.12 * pluck(t, 1e-3, 0.015); });
    if (beat > 0 && dice.chance(0.2)) continue;  // a rest
    const double note_hz = root_hz * scale[static_cast<std::size_t>(dice.count(0, 4))] * (dice.chance(0.3) ? 2.0 : 1.0);
    const auto note = [&](double frequency, double level, double fade_s) {
      for (int k = 1; k <= 14 && k * frequency < loop.highest_hz(); ++k)
        loop.add(beat * beat_s, 6 * fade_s,
                 [=](double t) { return level / k * pluck(t, 2e-3, fade_s / std::sqrt(k)) * std::sin(kTwoPi * k * frequency * t); });
    };
    note(note_hz, 1.0, decay_s);
    if (beat % 4 == 0) note(root_hz / 2, 0.8, 1.5 * decay_s);
  }
}

/// Coloured noise that swells.
void noise(Loop& loop, Dice& dice) {
  const double corner_hz = std::min(dice.between(600, 5000), loop.highest_hz());
  const double keep = std::exp(-kTwoPi * corner_hz / loop.rate_hz());
  const double swells_hz = loop.periodic(dice.between(1, 4)), depth = dice.between(0.1, 0.8);
  auto& samples = loop.samples();
  double state = 0;
  // Twice around: the second pass starts in the state in which it ends.
  for (std::size_t i = 0; i < 2 * samples.size(); ++i) {
    const std::size_t n = i % samples.size();
    state = keep * state + (1.0 - keep) * loop.noise(n);
    const double swell = 1.0 + depth * std::sin(kTwoPi * swells_hz * static_cast<double>(n) / loop.rate_hz());
    samples[n] = swell * (state + 0.05 * loop.noise(n));
  }
}

/// Syllables of a voice: harmonics under three formants, with consonants of hiss before them.
void speech(Loop& loop, Dice& dice) {
  const double pitch_hz = dice.between(95, 240), tract = dice.between(0.9, 1.2);
  const int syllables = std::max(3, static_cast<int>(std::lround(loop.length_s() * dice.between(3.5, 5.5))));
  const double slot_s = loop.length_s() / syllables;
  for (int syllable = 0; syllable < syllables; ++syllable) {
    const double start = syllable * slot_s;
    const double voiced_s = slot_s * dice.between(0.55, 0.95);
    const std::array<double, 3> formant_hz = {tract * dice.between(300, 850), tract * dice.between(900, 2300),
                                              tract * dice.between(2400, 3300)};
    const double from_hz = pitch_hz * dice.between(0.9, 1.25), bend = dice.between(-0.25, 0.15);
    for (int k = 1; k < 60; ++k) {
      const double frequency = k * from_hz;
      if (frequency * 1.2 > std::min(loop.highest_hz(), 6500.0)) break;
      double level = 0;
      for (const double formant : formant_hz) level += 1.0 / (1.0 + std::pow((frequency - formant) / (60.0 + 0.06 * formant), 2));
      level = (level + 0.01) / std::sqrt(k);
      loop.add(start, voiced_s,
               [=](double t) { return level * arch(t, voiced_s) * std::sin(kTwoPi * frequency * t * (1.0 + 0.5 * bend * t / voiced_s)); });
    }
    if (dice.chance(0.7)) {
      const double consonant_s = dice.between(0.03, 0.09);
      loop.add_hiss(start + slot_s - consonant_s, consonant_s, [=](double t) { return 0.15 * arch(t, consonant_s); });
    }
  }
}

/// A ticking rhythm.
void click(Loop& loop, Dice& dice) {
  const int slots = dice.count(8, 20);
  const double slot_s = loop.length_s() / slots;
  const double density = dice.between(0.5, 0.9);
  const double ring_hz = std::min(dice.between(900, 3500), loop.highest_hz());
  for (int slot = 0; slot < slots; ++slot) {
    if (slot > 0 && !dice.chance(density)) continue;
    const double level = slot % 4 == 0 ? 1.0 : dice.between(0.4, 0.8);
    loop.add(slot * slot_s, 0.05, [=](double t) { return level * pluck(t, 1e-4, 0.004) * std::cos(kTwoPi * ring_hz * t); });
    loop.add_hiss(slot * slot_s, 0.02, [=](double t) { return 0.6 * level * pluck(t, 1e-4, 0.0015); });
  }
}

/// A combustion engine: explosions of unequal strength at a low rate, each a thump and a burst of noise.
void engine(Loop& loop, Dice& dice) {
  const int explosions = std::max(4, 4 * static_cast<int>(std::lround(loop.length_s() * dice.between(22, 55) / 4.0)));
  const double period_s = loop.length_s() / explosions;
  std::array<double, 4> strength{};
  for (double& value : strength) value = dice.between(0.6, 1.0);
  const double thump_hz = dice.between(70, 140), rattle_hz = dice.between(300, 700);
  for (int i = 0; i < explosions; ++i) {
    const double level = strength[static_cast<std::size_t>(i % 4)];
    loop.add(i * period_s, 0.08, [=](double t) {
      return level *
             (pluck(t, 1e-3, 0.015) * std::sin(kTwoPi * thump_hz * t) + 0.4 * pluck(t, 1e-3, 0.006) * std::sin(kTwoPi * rattle_hz * t));
    });
    loop.add_hiss(i * period_s, 0.04, [=](double t) { return 0.25 * level * pluck(t, 1e-3, 0.008); });
  }
}

/// Chirps: fast sweeps in groups, with a little breath.
void bird(Loop& loop, Dice& dice) {
  const int groups = dice.count(2, 4);
  const double base_hz = dice.between(1900, 3000);
  for (int group = 0; group < groups; ++group) {
    const double start = (group + dice.between(0, 0.3)) * loop.length_s() / groups;
    const int chirps = dice.count(2, 6);
    const double chirp_s = dice.between(0.04, 0.11);
    const double from_hz = base_hz * dice.between(0.8, 1.3), sweep = dice.between(-0.45, 0.6);
    for (int chirp = 0; chirp < chirps; ++chirp) {
      const double at = start + chirp * chirp_s * 1.25;
      for (int k = 1; k <= 2; ++k) {
        if (k * from_hz * (1.0 + std::max(sweep, 0.0)) > loop.highest_hz()) break;
        loop.add(at, chirp_s, [=](double t) {
          return (k == 1 ? 1.0 : 0.3) * arch(t, chirp_s) * std::sin(kTwoPi * k * from_hz * t * (1.0 + 0.5 * sweep * t / chirp_s));
        });
      }
      // Wings and breath: these give low frequencies a direction cue, too.
      std::size_t index = static_cast<std::size_t>(at * loop.rate_hz());
      loop.add(at, chirp_s, [&, chirp_s](double t) { return 0.08 * arch(t, chirp_s) * loop.noise(++index); });
    }
  }
}

struct Kind {
  std::string_view name;
  double shortest_s, longest_s;
  void (*draw)(Loop&, Dice&);
};
constexpr std::array<Kind, 8> kKinds = {{{"telephone", 1.8, 3.0, telephone},
                                         {"alarm", 1.0, 2.0, alarm},
                                         {"music", 2.0, 3.0, music},
                                         {"noise", 1.0, 2.0, noise},
                                         {"speech", 1.5, 3.0, speech},
                                         {"click", 1.0, 2.0, click},
                                         {"engine", 1.0, 2.0, engine},
                                         {"bird", 1.2, 2.5, bird}}};

/// "synth:KIND[:SEED]" taken apart.
struct Recipe {
  std::size_t kind = 0;
  std::uint64_t seed = 0;
};

Recipe parse_recipe(const std::string& spec) {
  std::string known;
  for (const Kind& kind : kKinds) known += (known.empty() ? "" : ", ") + std::string(kind.name);
  const auto refuse = [&](std::string_view problem) -> InputError {
    return {spec, problem, fmt::format("write synth:KIND or synth:KIND:SEED with KIND one of {}", known)};
  };
  constexpr std::string_view prefix = "synth:";
  if (!spec.starts_with(prefix)) throw refuse("is not a synthetic sound");
  std::string_view rest = std::string_view(spec).substr(prefix.size());
  const std::size_t colon = rest.find(':');
  Recipe recipe;
  if (colon != std::string_view::npos) {
    const std::string_view digits = rest.substr(colon + 1);
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), recipe.seed);
    if (error != std::errc() || end != digits.data() + digits.size()) throw refuse("has a seed that is not a whole number in [0, 2^64)");
    rest = rest.substr(0, colon);
  }
  const auto found = std::find_if(kKinds.begin(), kKinds.end(), [&](const Kind& kind) { return kind.name == rest; });
  if (found == kKinds.end()) throw refuse("has an unknown kind of sound");
  recipe.kind = static_cast<std::size_t>(found - kKinds.begin());
  return recipe;
}

}  // namespace

SoundClip synthesize_sound(const std::string& spec, float sample_rate_hz) {
  require(sample_rate_hz >= 1000.f && sample_rate_hz <= 768000.f, "sample_rate_hz", sample_rate_hz, "must be in [1000, 768000]");
  const Recipe recipe = parse_recipe(spec);
  const Kind& kind = kKinds[recipe.kind];
  const auto stream = static_cast<std::uint32_t>(recipe.kind);
  Dice dice(recipe.seed, stream);
  Loop loop(dice.between(kind.shortest_s, kind.longest_s), sample_rate_hz, recipe.seed, stream);
  kind.draw(loop, dice);

  const auto& drawn = loop.samples();
  double mean = 0, peak = 0;
  for (const double value : drawn) mean += value / static_cast<double>(drawn.size());
  for (const double value : drawn) peak = std::max(peak, std::abs(value - mean));
  SoundClip clip{.name = spec, .sample_rate_hz = sample_rate_hz, .samples = std::vector<float>(drawn.size())};
  for (std::size_t i = 0; i < drawn.size(); ++i) clip.samples[i] = static_cast<float>((drawn[i] - mean) / peak * kPeak);
  return clip;
}

}  // namespace earshot
