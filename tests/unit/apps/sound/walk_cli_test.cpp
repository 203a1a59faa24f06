// SPDX-License-Identifier: Apache-2.0
// `earshot walk` against closed forms at true time: x(t - delay) along straight and mirrored paths, whoever moves; and its tails.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/random.h"
#include "tests/support/files/test_data.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

constexpr double kRateHz = 16000, kSpeedOfSound = 343.2;  // ISO 9613-1 at 20 C

/// Ten settings beside the one that was reported.
constexpr std::uint32_t kDrawn = 10;

/// Numbers of one drawn setting, in the order in which they are asked for.
class Draw {
 public:
  Draw(std::uint32_t test, std::uint32_t setting) : random_(33, Purpose::test, test, setting) {}
  double in(double low, double high) { return low + (high - low) * static_cast<double>(random_.uniform(draw_++)); }
  /// On the horizontal circle.
  glm::dvec3 direction() {
    const double angle = in(0, 2 * std::numbers::pi);
    return {std::cos(angle), 0, std::sin(angle)};
  }

 private:
  RandomStream random_;
  std::uint32_t draw_ = 0;
};

/// From `start` with `velocity` for ever.
struct Motion {
  glm::dvec3 start{0}, velocity{0};
  [[nodiscard]] glm::dvec3 at(double t_s) const { return start + t_s * velocity; }
  /// The rows of a file of poses, from 0 to duration_s.
  [[nodiscard]] std::string rows(double duration_s) const {
    const glm::dvec3 end = at(duration_s);
    return fmt::format("t_s,x,y,z,heading_deg\n0,{},{},{},0\n{},{},{},{},0\n", start.x, start.y, start.z, duration_s, end.x, end.y, end.z);
  }
};

/// A second of tones of whole Hz, which therefore loops without a seam.
class Tones {
 public:
  Tones(Draw draw, int count, double highest_hz) {
    for (int i = 0; i < count; ++i) {
      hz_.push_back(std::floor(draw.in(100, highest_hz)));
      phase_.push_back(draw.in(0, 2 * std::numbers::pi));
    }
  }
  [[nodiscard]] double at(double t_s) const {
    double sum = 0;
    for (std::size_t i = 0; i < hz_.size(); ++i) sum += std::sin(2 * std::numbers::pi * hz_[i] * t_s + phase_[i]);
    return sum;
  }
  void write(const std::string& file) const {
    std::vector<float> samples(static_cast<std::size_t>(kRateHz));
    for (std::size_t n = 0; n < samples.size(); ++n) samples[n] = static_cast<float>(at(static_cast<double>(n) / kRateHz));
    write_wav(file, samples, 1, static_cast<float>(kRateHz));
  }

 private:
  std::vector<double> hz_, phase_;
};

/// The delay of what arrives at t_s from a source that moves: c d = |listener(t) - source(t - d)|, solved in closed form.
double delay_s(const Motion& listener, const Motion& source, double t_s) {
  const glm::dvec3 apart = listener.at(t_s) - source.at(t_s), v = source.velocity;
  const double a = kSpeedOfSound * kSpeedOfSound - glm::dot(v, v), b = glm::dot(apart, v);
  return (b + std::sqrt(b * b + a * glm::dot(apart, apart))) / a;
}

/// Energy of the difference over that of `expected` in dB, from sample `first` on.
double residual_db(std::span<const float> heard, std::span<const float> expected, std::size_t first) {
  double difference = 0, energy = 0;
  for (std::size_t n = first; n < expected.size(); ++n) {
    difference += std::pow(static_cast<double>(heard[n] - expected[n]), 2);
    energy += std::pow(static_cast<double>(expected[n]), 2);
  }
  return 10 * std::log10(difference / energy);
}

class WalkCli : public Cli {
 protected:
  /// Of a hall of which direct sound and the reflection in the ground are heard, or the former alone.
  [[nodiscard]] std::vector<float> walk_outside(const std::string& options, bool ground) const {
    const std::string line = fmt::format(
        "walk shoebox:400x60x400@1,1,{},1,1,1 --channels mono --set late=off diffraction=off air_absorption=off scattering=0 early_order=1 "
        "rir_length_s=1.2 --out {} {}",
        ground ? 0 : 1, file("heard.wav"), options);
    const CliOutcome outcome = earshot(line);
    EXPECT_EQ(outcome.exit_code, 0) << line << "\n" << outcome.errors;
    return read_wav("heard.wav");
  }
  /// Listener and source on straight lines over the ground, against x(t - d) / (4 pi c d) of the source and its mirror image.
  void expect_closed_form(const Motion& listener, const Motion& source, double duration_s, double step_s, std::uint32_t seed) const {
    const Tones tones(Draw(90, seed), 20, 1000);
    tones.write(file("tones.wav"));
    write("listener.csv", listener.rows(duration_s));
    write("source.csv", source.rows(duration_s));
    const std::string where = source.velocity == glm::dvec3(0)
                                  ? fmt::format("--source {},{},{}", source.start.x, source.start.y, source.start.z)
                                  : "--source-path " + file("source.csv");
    const std::string options = fmt::format("--poses {} {} --sound {} --step {}", file("listener.csv"), where, file("tones.wav"), step_s);
    const std::vector<float> heard = walk_outside(options, true);
    const Motion image{source.start * glm::dvec3(1, -1, 1), source.velocity * glm::dvec3(1, -1, 1)};
    std::vector<float> expected(heard.size());
    for (std::size_t n = 0; n < heard.size(); ++n) {
      const double t = static_cast<double>(n) / kRateHz;
      for (const Motion& from : {source, image}) {
        const double delay = delay_s(listener, from, t);
        expected[n] += static_cast<float>(tones.at(t - delay) / (4 * std::numbers::pi * kSpeedOfSound * delay));
      }
    }
    // Both have begun, and what a source that has stood before it began to move leaves is over.
    const double settled_s = 1.2 * std::max(delay_s(listener, image, 0), delay_s(listener, image, duration_s)) + step_s;
    const auto first = static_cast<std::size_t>(settled_s * kRateHz);
    ASSERT_LT(first, heard.size() / 2);
    // Delays on straight lines between the steps leave most; a step late leaves +3 dB, a source where it is now instead of where it was
    // too.
    EXPECT_LT(residual_db(heard, expected, first), -20) << options << "\n" << listener.rows(duration_s) << source.rows(duration_s);
  }
};

TEST_F(WalkCli, IsInTimeWithTheListenersPoses) {
  for (const double step_s : {0.05, 0.151}) expect_closed_form({{150, 1.6, 160}, {1.4, 0, 0}}, {{140, 2, 150}, {}}, 2, step_s, 0);
  for (std::uint32_t i = 0; i < kDrawn; ++i) {
    Draw draw(1, i);
    const double speed = draw.in(0.3, 3);
    const Motion source{{draw.in(150, 250), draw.in(1, 4), draw.in(150, 250)}, {}};
    const Motion listener{source.start + draw.in(10, 20) * draw.direction() + glm::dvec3(0, draw.in(-0.5, 3), 0), speed * draw.direction()};
    expect_closed_form(listener, source, draw.in(1, 2), draw.in(0.01, 0.15), i);
  }
}

TEST_F(WalkCli, HearsAMovingSourceFromWhereItWas) {
  expect_closed_form({{100, 2, 200}, {}}, {{160, 1.5, 200}, {-20, 0, 0}}, 1.5, 0.05, 20);
  for (std::uint32_t i = 0; i < kDrawn; ++i) {
    Draw draw(2, i);
    const Motion listener{{draw.in(190, 210), draw.in(1, 4), draw.in(190, 210)}, draw.in(0, 3) * draw.direction()};
    const Motion source{listener.start + draw.in(60, 100) * draw.direction() + glm::dvec3(0, draw.in(-0.5, 3), 0),
                        draw.in(3, 30) * draw.direction()};
    expect_closed_form(listener, source, 1.5, draw.in(0.01, 0.03), 20 + i);
  }
}

/// Frequency of the tone near `hz` in samples [first, first + size): from the change of its phase between the two halves.
double frequency_hz(std::span<const float> heard, std::size_t first, std::size_t size, double hz) {
  std::array<double, 2> phase{};
  const std::size_t half = size / 2;
  for (std::size_t part = 0; part < 2; ++part) {
    double re = 0, im = 0;
    for (std::size_t n = 0; n < half; ++n) {
      const std::size_t at = first + part * half + n;
      const double window = 0.5 - 0.5 * std::cos(2 * std::numbers::pi * (static_cast<double>(n) + 0.5) / static_cast<double>(half));
      const double turn = 2 * std::numbers::pi * hz * static_cast<double>(at) / kRateHz;
      re += window * static_cast<double>(heard[at]) * std::cos(turn);
      im -= window * static_cast<double>(heard[at]) * std::sin(turn);
    }
    phase[part] = std::atan2(im, re);
  }
  return hz + std::remainder(phase[1] - phase[0], 2 * std::numbers::pi) / (2 * std::numbers::pi) * kRateHz / static_cast<double>(half);
}

// f (c + listener toward the source) / (c - source toward the listener), on one line, within a cent.
TEST_F(WalkCli, PitchIsThatOfTheRetardedPosition) {
  std::vector<float> tone(16000);
  for (std::size_t n = 0; n < tone.size(); ++n)
    tone[n] = static_cast<float>(std::sin(2.0 * std::numbers::pi * 1000.0 * static_cast<double>(n) / kRateHz));
  write_wav(file("tone.wav"), tone, 1, static_cast<float>(kRateHz));
  const auto expect_pitch = [&](const std::string& poses, const std::string& path, double listener_speed, double source_speed,
                                double step_s) {
    const std::vector<float> heard =
        walk_outside(fmt::format("--poses {} --source-path {} --sound {} --step {}", poses, path, file("tone.wav"), step_s), false);
    const double expected_hz = 1000 * (kSpeedOfSound + listener_speed) / (kSpeedOfSound - source_speed);
    // From when the motion is heard on; the halves are so short that phases of neighbouring pitches stay apart.
    const double found_hz = frequency_hz(heard, 16000, 3000, expected_hz);
    EXPECT_LT(std::abs(1200 * std::log2(found_hz / expected_hz)), 1)
        << found_hz << " Hz for " << expected_hz << " Hz: listener " << listener_speed << " m/s, source " << source_speed << " m/s, step "
        << step_s;
  };
  for (std::uint32_t i = 0; i < kDrawn + 2; ++i) {
    Draw draw(3, i);
    const glm::dvec3 toward = draw.direction();
    const double listener_speed = i < 2 ? 0 : draw.in(-10, 10), source_speed = i == 0 ? 20 : i == 1 ? 5 : draw.in(-40, 40);
    const double step_s = i < 2 ? 0.05 : draw.in(0.01, 0.2);
    const Motion listener{{200, 5, 200}, listener_speed * toward};
    const Motion source{listener.start + draw.in(130, 140) * toward, -source_speed * toward};
    expect_pitch(write("listener.csv", listener.rows(1.4)), write("source.csv", source.rows(1.4)), listener_speed, source_speed, step_s);
  }
  SKIP_WITHOUT_DATA("field/c14_fast_approach.csv");
  const auto field = [](const char* name) { return (data_folder() / "field" / name).string(); };
  expect_pitch(field("c14_fast_rest.csv"), field("c14_fast_approach.csv"), 0, 30, 0.05);
}

/// Where between samples the band-limited pulse near sample `near` is largest: sinc interpolation, by bisecting three times the step.
double peak_sample(std::span<const float> heard, double near) {
  const auto value = [&](double at) {
    double sum = 0;
    const auto middle = static_cast<std::ptrdiff_t>(std::lround(near));
    for (std::ptrdiff_t n = std::max<std::ptrdiff_t>(0, middle - 40); n <= middle + 40; ++n) {
      const double x = std::numbers::pi * (at - static_cast<double>(n));
      sum += static_cast<double>(heard[static_cast<std::size_t>(n)]) * (std::abs(x) < 1e-9 ? 1 : std::sin(x) / x);
    }
    return std::abs(sum);
  };
  double best = near;
  for (double step = 1, span = 12; step > 1e-4; span = step, step /= 10) {
    const double middle = best;
    for (double at = middle - span; at <= middle + span; at += step)
      if (value(at) > value(best)) best = at;
  }
  return best;
}

// A click at t reaches a listener at r + v t when t + (r + v t') / c = t'.
TEST_F(WalkCli, ClicksArriveWhereTheListenerIsByThen) {
  std::vector<float> clicks(16000);
  for (const std::size_t at : {0u, 4000u, 8000u, 12000u}) clicks[at] = 1;
  write_wav(file("clicks.wav"), clicks, 1, static_cast<float>(kRateHz));
  const auto expect_arrivals = [&](const std::string& options, double start_m, double speed, double duration_s) {
    const std::vector<float> heard = walk_outside(options, false);
    int counted = 0;
    for (double sent_s = 0.25; sent_s < duration_s; sent_s += 0.25) {
      const double arrival = (sent_s + start_m / kSpeedOfSound) / (1 - speed / kSpeedOfSound) * kRateHz;
      if (arrival + 60 > static_cast<double>(heard.size())) break;
      EXPECT_NEAR(peak_sample(heard, std::round(arrival)), arrival, 0.05) << options << ", click at " << sent_s << " s";
      ++counted;
    }
    EXPECT_GE(counted, 3);
  };
  for (std::uint32_t i = 0; i < kDrawn; ++i) {
    Draw draw(4, i);
    const double speed = draw.in(-8, 20), start_m = draw.in(20, 60), duration_s = draw.in(1.2, 2), step_s = draw.in(0.01, 0.3);
    const glm::dvec3 away = draw.direction(), source{200, 3, 200};
    write("listener.csv", Motion{source + start_m * away, speed * away}.rows(duration_s));
    expect_arrivals(fmt::format("--poses {} --source 200,3,200 --sound {} --step {}", file("listener.csv"), file("clicks.wav"), step_s),
                    start_m, speed, duration_s);
  }
  SKIP_WITHOUT_DATA("field/clicks.wav");
  const auto field = [](const char* name) { return (data_folder() / "field" / name).string(); };
  expect_arrivals(fmt::format("--poses {} --source 2,2,2 --sound {}", field("c14_listener_leaves.csv"), field("clicks.wav")), 1, 2, 10);
}

/// Two sources of a room, and a walk in it.
class WalkTails : public WalkCli {
 protected:
  [[nodiscard]] std::vector<float> heard(const std::string& sources, const std::string& options = "") const {
    const std::string line = "walk shoebox:7x3x6@0.15 --channels mono --preset fast --set field=off rays=64 rir_length_s=0.6 --poses " +
                             file("poses.csv") + " " + sources + " --sound " + file("clicks.wav") + " --out " + file("heard.wav") + options;
    const CliOutcome outcome = earshot(line);
    EXPECT_EQ(outcome.exit_code, 0) << line << "\n" << outcome.errors;
    return read_wav("heard.wav");
  }
  static glm::dvec3 place(Draw& draw) { return {draw.in(0.7, 6.3), draw.in(0.7, 2.3), draw.in(0.7, 5.3)}; }
  void write_inputs(Draw& draw, bool moves) const {
    const glm::dvec3 from = place(draw), to = moves ? place(draw) : from;
    write("poses.csv", Motion{from, (to - from) / 0.6}.rows(0.6));
    std::vector<float> click(16000);
    click[0] = 1;
    write_wav(file("clicks.wav"), click, 1, static_cast<float>(kRateHz));
  }
  /// A source at a drawn place, or one that moves from there.
  [[nodiscard]] std::string source(Draw& draw, const std::string& name, bool moves) const {
    const glm::dvec3 from = place(draw);
    if (!moves) return fmt::format("--source {},{},{} ", from.x, from.y, from.z);
    return "--source-path " + write(name, Motion{from, (place(draw) - from) / 0.6}.rows(0.6)) + " ";
  }
  static std::vector<float> sum(std::span<const float> a, std::span<const float> b) {
    std::vector<float> both(a.begin(), a.end());
    for (std::size_t n = 0; n < both.size(); ++n) both[n] += b[n];
    return both;
  }
  static constexpr std::size_t kTail = 2400;  ///< behind every early path
};

TEST_F(WalkTails, SourcesAddUpAndAreUncorrelated) {
  for (std::uint32_t i = 0; i < kDrawn + 1; ++i) {
    Draw draw(5, i);
    write_inputs(draw, i % 3 != 0);
    // Sources at rest come first in a walk: one of each kind is a pair too.
    const std::string first = source(draw, "first.csv", i % 4 == 1), second = source(draw, "second.csv", i % 4 == 1 || i % 4 == 2);
    const std::vector<float> a = heard(first), b = heard(second), both = heard(first + second);
    EXPECT_LT(residual_db(both, sum(a, b), 0), -100) << first << second;
    EXPECT_LT(residual_db(heard(second + first), both, 0), -100) << first << second;
    double product = 0, of_a = 0, of_b = 0;
    for (std::size_t n = kTail; n < a.size(); ++n) {
      const double x{a[n]}, y{b[n]};
      product += x * y, of_a += x * x, of_b += y * y;
    }
    // 7,000 samples of which the last ones are quiet: a thousand that count, five standard errors.
    EXPECT_LT(std::abs(product) / std::sqrt(of_a * of_b), 0.16) << first << second;
  }
}

TEST_F(WalkTails, AtRestAWalkIsItsImpulseResponse) {
  for (std::uint32_t i = 0; i < kDrawn; ++i) {
    Draw draw(6, i);
    const glm::dvec3 listener = place(draw), source = place(draw);
    write("poses.csv", Motion{listener, {}}.rows(0.6));
    std::vector<float> click(16000);
    click[0] = 1;
    write_wav(file("clicks.wav"), click, 1, static_cast<float>(kRateHz));
    const std::vector<float> walk = heard(fmt::format("--source {},{},{}", source.x, source.y, source.z));
    const CliOutcome outcome =
        earshot(fmt::format("rir shoebox:7x3x6@0.15 --channels mono --preset fast --set field=off rays=64 rir_length_s=0.6 --source "
                            "{},{},{} --listener {},{},{} --out {}",
                            source.x, source.y, source.z, listener.x, listener.y, listener.z, file("rir.wav")));
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
    const std::vector<float> rir = read_wav("rir.wav");
    EXPECT_LT(residual_db(walk, std::span(rir).first(std::min(rir.size(), walk.size())), kTail), -60);
  }
}

// A file cut within a line is invalid; a file cut between two lines is a shorter, valid path.
TEST_F(WalkCli, PosesThatWereCutAreRefused) {
  Draw draw(7, 0);
  std::string rows = "# a walk\nt_s,x,y,z,heading_deg\n";
  for (int i = 0; i < 12; ++i)
    rows +=
        fmt::format("{:.3f},{:.4f},{:.2f},{:.3f},{:.1f}\n", 0.01 * i, draw.in(10, 11), draw.in(1, 2), draw.in(10, 11), draw.in(-180, 180));
  const std::string whole = write("whole.csv", rows);
  int refused = 0;
  for (int i = 0; i < 24; ++i) {
    const auto size = static_cast<std::size_t>(draw.in(1, static_cast<double>(rows.size() - 1)));
    const std::string kept = rows.substr(0, size), cut = write("cut.csv", kept), out = file("cut.wav");
    const std::string line =
        "walk shoebox:20x4x20@1 --channels mono --set late=off early=off diffraction=off rir_length_s=0.1 --sound synth:noise --out " +
        out + (i % 2 == 0 ? " --source 5,1,5 --poses " + cut : " --poses " + whole + " --source-path " + cut);
    if (kept.back() == '\n' && std::count(kept.begin(), kept.end(), '\n') >= 4) {
      EXPECT_EQ(earshot(line).exit_code, 0) << kept;
      std::filesystem::remove(out);
      continue;
    }
    ++refused;
    expect_bad_input(line, "cut.csv");
    EXPECT_FALSE(std::filesystem::exists(out));
  }
  EXPECT_GE(refused, 20);
}

}  // namespace
}  // namespace earshot
