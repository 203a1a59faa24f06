// SPDX-License-Identifier: Apache-2.0
// H-61: measured heads whose files are unusual, incomplete or damaged.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/audio/head/hrtf.h"
#include "sim/audio/head/sofa_reader.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

/// Impulses in all directions: the right ear later than the left one by `onset` samples of the response and `delay` of Data.Delay.
SofaResponses impulses(float sample_rate_hz, int onset, float delay) {
  SofaResponses head;
  head.sample_rate_hz = sample_rate_hz;
  head.num_taps = 64;
  constexpr int num_directions = 60;
  for (int i = 0; i < num_directions; ++i) {
    const double height = (2.0 * i + 1.0) / num_directions - 1.0, radius = std::sqrt(1.0 - height * height);
    const double angle = 2.0 * std::numbers::pi * i * std::numbers::phi;
    head.direction.emplace_back(radius * std::cos(angle), height, radius * std::sin(angle));
    for (int ear = 0; ear < 2; ++ear) {
      std::vector<float> response(64, 0.f);
      response[static_cast<std::size_t>(10 + ear * onset)] = 1.f;
      head.taps.insert(head.taps.end(), response.begin(), response.end());
      head.delay_samples.push_back(ear == 0 ? 0.f : delay);
    }
  }
  return head;
}

struct Cues {
  double lag_s;      ///< of the right ear, from the phases up to 1.5 kHz
  double spread_db;  ///< largest difference of a level to that at 500 Hz, up to 0.4 of the lower rate
};

Cues cues_of(const Hrtf& head, glm::vec3 direction, double top_hz) {
  const auto bins = static_cast<std::size_t>(head.fft_size() / 2 + 1);
  std::vector<std::complex<float>> left(bins), right(bins);
  head.spectra(direction, left, right);
  const double bin_hz = static_cast<double>(head.sample_rate_hz()) / head.fft_size();
  const auto bin = [&](double frequency_hz) { return static_cast<std::size_t>(std::lround(frequency_hz / bin_hz)); };
  Cues cues{0, 0};
  double weight = 0;
  for (std::size_t k = 1; k < bin(1500.0); ++k) {  // least squares through zero of phase over frequency
    const double omega = 2.0 * std::numbers::pi * static_cast<double>(k) * bin_hz;
    cues.lag_s -= omega * static_cast<double>(std::arg(right[k] * std::conj(left[k])));
    weight += omega * omega;
  }
  cues.lag_s /= weight;
  for (const auto* ear : {&left, &right})
    for (std::size_t k = bin(200.0); k < bin(top_hz); ++k)
      cues.spread_db =
          std::max(cues.spread_db, std::abs(20.0 * std::log10(static_cast<double>(std::abs((*ear)[k]) / std::abs((*ear)[bin(500.0)])))));
  return cues;
}

// Two samples at 44.1 kHz are 45.4 us, whatever the rate of the simulation and whether the file holds them in its taps or beside them.
// The transform of an impulse is exact at every frequency; 0.5 us is 1 % of what is measured, and 0.02 dB the rounding of floats: a
// response resampled twice, or at the wrong ratio, misses both.
TEST(H61_SofaOnsets, ADifferenceOfTwoSamplesIsKeptAtEveryRate) {
  for (const float rate : {16000.f, 44100.f, 48000.f}) {
    for (const bool beside : {false, true}) {
      const auto head = Hrtf::from_responses(impulses(44100.f, beside ? 0 : 2, beside ? 2.f : 0.f), rate, "head.sofa");
      for (const glm::vec3 direction : {glm::vec3(0, 0, -1), glm::vec3(1, 0, 0), glm::normalize(glm::vec3(-1, 1, 0.3f))}) {
        const Cues cues = cues_of(*head, direction, 0.4 * std::min(rate, 44100.f));
        EXPECT_NEAR(cues.lag_s, 2.0 / 44100.0, 0.5e-6) << rate << (beside ? " in Data.Delay" : " in the taps");
        EXPECT_LT(cues.spread_db, 0.02) << rate;
      }
    }
  }
}

TEST(H61_SofaOnsets, AnotherRateOfTheFileIsReadInSeconds) {
  for (const float file_rate : {8000.f, 48000.f, 192000.f}) {
    const auto head = Hrtf::from_responses(impulses(file_rate, 2, 0.f), 16000.f, "head.sofa");
    EXPECT_NEAR(cues_of(*head, {0, 0, -1}, 0.4 * std::min(file_rate, 16000.f)).lag_s, 2.0 / static_cast<double>(file_rate), 1e-6)
        << file_rate;
  }
}

TEST(H61_SofaFields, ResponsesThatCannotBeAreRefusedByName) {
  const auto refusal = [](auto change) {
    SofaResponses head = impulses(44100.f, 2, 0.f);
    change(head);
    return message_of<InputError>([&] { Hrtf::from_responses(head, 16000.f, "head.sofa"); });
  };
  const float nan = std::nanf("");
  EXPECT_EQ(refusal([](SofaResponses&) {}), "");
  EXPECT_THAT(refusal([](SofaResponses& h) { h.taps.pop_back(); }), AllOf(StartsWith("head.sofa: "), HasSubstr("Data.IR")));
  EXPECT_THAT(refusal([&](SofaResponses& h) { h.taps[77] = nan; }), HasSubstr("Data.IR"));
  EXPECT_THAT(refusal([](SofaResponses& h) { std::fill(h.taps.begin(), h.taps.end(), 0.f); }), HasSubstr("only zeros in Data.IR"));
  EXPECT_THAT(refusal([&](SofaResponses& h) { h.delay_samples[3] = nan; }), HasSubstr("Data.Delay"));
  EXPECT_THAT(refusal([](SofaResponses& h) { h.delay_samples[3] = -1.f; }), HasSubstr("Data.Delay"));
  EXPECT_THAT(refusal([](SofaResponses& h) { h.delay_samples.clear(); }), HasSubstr("Data.Delay"));
  EXPECT_THAT(refusal([](SofaResponses& h) { h.direction[4] = glm::vec3(0); }), HasSubstr("SourcePosition 4"));
  EXPECT_THAT(refusal([&](SofaResponses& h) { h.direction[4] = glm::vec3(nan); }), HasSubstr("SourcePosition 4"));
  EXPECT_THAT(refusal([](SofaResponses& h) { h.direction.clear(); }), HasSubstr("(M)"));
  EXPECT_THAT(refusal([](SofaResponses& h) { h.num_taps = 0; }), HasSubstr("(N)"));
  EXPECT_THAT(refusal([](SofaResponses& h) { h.sample_rate_hz = 3.f; }), HasSubstr("Data.SamplingRate"));
  EXPECT_THAT(refusal([&](SofaResponses& h) { h.sample_rate_hz = nan; }), HasSubstr("Data.SamplingRate"));
}

// 100,000 measurements of a whole second: valid field by field, and hours of work.
TEST(H61_SofaFields, MoreThanAHeadNeedsIsRefusedBeforeTheWork) {
  SofaResponses head = impulses(1000.f, 2, 0.f);
  const std::vector<float> response(16384, 0.1f);
  head.num_taps = static_cast<int>(response.size());
  head.taps.clear();
  for (std::size_t row = 0; row < head.delay_samples.size(); ++row) head.taps.insert(head.taps.end(), response.begin(), response.end());
  EXPECT_THAT(message_of<InputError>([&] { Hrtf::from_responses(head, 384000.f, "hall.sofa"); }),
              AllOf(StartsWith("hall.sofa: "), HasSubstr("too much")));
}

class H61_SofaFiles : public testing::Test {
 protected:
  void SetUp() override {
    SKIP_WITHOUT_DATA("hrtf/MIT_KEMAR_normal_pinna.sofa");
    path_ = data_folder() / "hrtf/MIT_KEMAR_normal_pinna.sofa";
    whole_ = read_file(path_);
  }
  /// The message when the file is read with `from` replaced by `to`, of the same length, at its first place.
  std::string refusal_with(std::string_view from, std::string_view to) {
    std::string bytes = whole_;
    const std::size_t at = bytes.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    bytes.replace(at, from.size(), to);
    const TempFolder folder;
    const std::string file = folder.write("head.sofa", bytes);
    return message_of<InputError>([&] { read_sofa(file); });
  }
  std::filesystem::path path_;
  std::string whole_;
};

TEST_F(H61_SofaFiles, AMissingVariableIsNamed) {
  EXPECT_THAT(refusal_with("Data.IR", "Data.IX"), HasSubstr("Data.IR"));
  EXPECT_THAT(refusal_with("Data.SamplingRate", "Data.SamplingRota"), HasSubstr("Data.SamplingRate"));
  EXPECT_THAT(refusal_with("SourcePosition", "SaucePosition!"), HasSubstr("SourcePosition"));
  EXPECT_THAT(refusal_with("ReceiverPosition", "ReceiverPositiox"), HasSubstr("ReceiverPosition"));
}

TEST_F(H61_SofaFiles, TheOtherProcessChangesNoBit) {
  const SofaResponses there = read_sofa(path_), here = parse_sofa(path_);
  EXPECT_EQ(there.sample_rate_hz, here.sample_rate_hz);
  EXPECT_EQ(there.num_taps, here.num_taps);
  EXPECT_EQ(there.direction, here.direction);
  EXPECT_EQ(there.taps, here.taps);
  EXPECT_EQ(there.delay_samples, here.delay_samples);
}

}  // namespace
}  // namespace earshot
