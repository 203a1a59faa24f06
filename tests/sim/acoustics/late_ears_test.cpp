#include "sim/acoustics/late_ears.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "sim/acoustics/rir_synthesis.h"
#include "tests/sim/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

std::shared_ptr<const SynthesisTables> tables_with(float late_decode_s) {
  AcousticConfig config = config_at(16000.f);
  config.late_decode_s = late_decode_s;
  return make_synthesis_tables(config, BandLayout::octaves(16000.f), ChannelLayout::binaural, Hrtf::rigid_sphere(16000.f));
}
/// The whole late field through the decoder, or none of it.
const std::shared_ptr<const SynthesisTables>& decoded_tables() {
  static const auto tables = tables_with(60.f);
  return tables;
}
const std::shared_ptr<const SynthesisTables>& mixed_tables() {
  static const auto tables = tables_with(0.f);
  return tables;
}

/// Energy at both ears and their product over many stretches of noise.
struct EarCovariance {
  double left = 0, right = 0, cross = 0;
  [[nodiscard]] double correlation() const { return cross / std::sqrt(left * right); }
};
EarCovariance covariance_of(const std::shared_ptr<const SynthesisTables>& tables, const EnergyHistogram& late, const ListenerTurn& turn) {
  RirSynthesizer synthesizer(tables);
  EnergyResponse response = response_with();
  response.late = late;
  EarCovariance sum;
  Rir rir;
  for (std::uint64_t key = 0; key < 24; ++key) {
    synthesizer.render(response, turn, key, rir);
    const auto left = rir.channel(0), right = rir.channel(1);
    sum.left += energy_of(left);
    sum.right += energy_of(right);
    for (std::size_t n = 0; n < left.size(); ++n) sum.cross += static_cast<double>(left[n]) * static_cast<double>(right[n]);
  }
  return sum;
}

// A field of any direction, in one band at a time, gives each ear the power, and both the correlation, that it has through the decoder.
// The stretches cover a loop of one second, in which flattened noise has its power within 0.1 dB, and products of it within 0.015 of their
// share.  A factor of two is 3 dB.
TEST(LateEars, PowersAndCorrelationAreThoseOfTheDecoder) {
  struct Case {
    glm::vec3 from;
    float directivity;
    ListenerTurn turn;
  };
  const Case cases[] = {{{0, 0, -1}, 0.f, ListenerTurn(0.7)},         {{1, 0, 0}, 0.5f, ListenerTurn(0.0)},
                        {{1, 0, 0}, 1.f, ListenerTurn(0.6)},          {{0, 0, -1}, 1.f, ListenerTurn(0.0)},
                        {{0, 1, 0}, 0.8f, ListenerTurn(0, 0.4, 0.7)}, {{-0.6f, 0, 0.8f}, 0.7f, ListenerTurn(-2.0)}};
  constexpr int num_bands = 7;
  for (const Case& c : cases) {
    for (int band = 0; band < num_bands; ++band) {
      EnergyHistogram late = decay_of(3.0, 0.02, num_bands, 0.004f, 0.5, 1, c.from, c.directivity);
      for (std::size_t i = 0; i < late.values().size(); ++i)
        if (static_cast<int>(i / 4) % num_bands != band) late.values()[i] = 0;
      const EarCovariance decoded = covariance_of(decoded_tables(), late, c.turn), mixed = covariance_of(mixed_tables(), late, c.turn);
      EXPECT_NEAR(db(mixed.left / decoded.left), 0.0, 0.2) << c.directivity << ", band " << band;
      EXPECT_NEAR(db(mixed.right / decoded.right), 0.0, 0.2) << c.directivity << ", band " << band;
      EXPECT_NEAR(mixed.correlation(), decoded.correlation(), 0.03) << c.directivity << ", band " << band;
    }
  }
}

// Up to the slot where decoding ends nothing differs; from there to the next slot the one falls in power as the other grows, so that the
// level of a steady field has neither a dip nor a bump: 20 ms of white noise at two ears and 64 keys are 0.1 dB.
TEST(LateEars, TakesOverWithoutAStep) {
  constexpr float decode_s = 0.1f;
  constexpr int keys = 64, onset = 320, block = 320;
  const auto tables = tables_with(decode_s);
  RirSynthesizer synthesizer(tables), decoding(decoded_tables());
  EnergyResponse response = response_with({arrival_at(onset / 16000.0 * 343.0, 0.0)});
  response.late = decay_of(1e6, 1e5, 7, 0.004f, 0.5, 1, {1, 0, 0}, 0.4f);
  std::array<double, 8000 / block> level{}, decoded_level{};
  double worst = 0;
  for (std::uint64_t key = 0; key < keys; ++key) {
    const Rir rir = rendered(synthesizer, response, 0.3, key), decoded = rendered(decoding, response, 0.3, key);
    const double peak = static_cast<double>(*std::ranges::max_element(decoded.samples));
    for (int ear = 0; ear < 2; ++ear)
      for (int n = 0; n < 8000; ++n) {
        // The slot of 4 ms before 0.12 s, less the 2 ms by which the decoder rings ahead.
        if (n < onset + 1600 - 64 - 32)
          worst = std::max(worst, std::abs(static_cast<double>(rir.channel(ear)[n] - decoded.channel(ear)[n])) / peak);
        const auto at = static_cast<std::size_t>(n / block);
        level[at] += static_cast<double>(rir.channel(ear)[n]) * static_cast<double>(rir.channel(ear)[n]);
        decoded_level[at] += static_cast<double>(decoded.channel(ear)[n]) * static_cast<double>(decoded.channel(ear)[n]);
      }
  }
  EXPECT_LT(worst, 1e-5);
  for (std::size_t i = 2; i + 1 < level.size(); ++i) EXPECT_NEAR(db(level[i] / decoded_level[i]), 0.0, 0.3) << i;
  EXPECT_NE(level.back(), decoded_level.back());
}

// The two noises of a band are uncorrelated, and have the powers that a diffuse field has through the decoder.
TEST(EarNoise, MixesADiffuseFieldBackToItself) {
  const auto head = Hrtf::rigid_sphere(16000.f);
  const BandLayout bands = BandLayout::octaves(16000.f);
  const CarrierBank carriers(bands, 16000.f, 4, 1 << 14, 0);
  const EarNoise noise(carriers, bands, *head);
  const auto bins = static_cast<std::size_t>(head->fft_size() / 2 + 1);
  double expected = 0;
  for (std::size_t k = 0; k < bins; ++k)
    for (int c = 0; c < 4; ++c) expected += std::norm(head->diffuse_decoder(c, 0)[k]) / static_cast<double>(bins);
  std::vector<float> whole_left(1 << 14), whole_right(1 << 14);
  for (int band = 0; band < bands.size(); ++band) {
    const EarNoise::Mix mix = noise.mix(band, {0, 0, 0});
    double both = 0;
    const auto first = noise.loop(band, 0), second = noise.loop(band, 1);
    for (std::size_t n = 0; n < first.size(); ++n) {
      both += static_cast<double>(first[n]) * static_cast<double>(second[n]);
      whole_left[n] += mix.left * first[n];
      whole_right[n] += mix.shared * first[n] + mix.own * second[n];
    }
    EXPECT_NEAR(both / std::sqrt(energy_of(first) * energy_of(second)), 0.0, 1e-4) << band;
  }
  const double left = energy_of(whole_left) / static_cast<double>(whole_left.size());
  const double right = energy_of(whole_right) / static_cast<double>(whole_right.size());
  EXPECT_NEAR(db(left / expected), 0.0, 0.1);
  EXPECT_NEAR(db(right / expected), 0.0, 0.1);
}

// Whatever finite direction a slot claims, its mixes are finite and have the powers asked for: even one past its own energy.
TEST(EarNoise, StaysFiniteForEveryDirection) {
  const BandLayout bands = BandLayout::octaves(16000.f);
  const CarrierBank carriers(bands, 16000.f, 4, 4096, 0);
  const EarNoise noise(carriers, bands, *Hrtf::rigid_sphere(16000.f));
  for (int band = 0; band < bands.size(); ++band)
    for (const float size : {0.f, 1e-20f, 0.5f, 1.7320508f, 2.f})
      for (const glm::vec3 side :
           {glm::vec3(1, 0, 0), glm::vec3(-1, 0, 0), glm::vec3(0, 1, 0), glm::vec3(0, 0, 1), glm::vec3(0.6f, 0.8f, 0)}) {
        const EarNoise::Mix mix = noise.mix(band, {size * side.x, size * side.y, size * side.z});
        for (const float factor : {mix.left, mix.shared, mix.own}) ASSERT_TRUE(std::isfinite(factor) && std::abs(factor) < 4.f);
        EXPECT_GE(mix.left, 0.f);
        EXPECT_GE(mix.own, 0.f);
      }
}

}  // namespace
}  // namespace earshot
