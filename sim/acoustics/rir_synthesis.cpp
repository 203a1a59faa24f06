#include "sim/acoustics/rir_synthesis.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>

#include "sim/acoustics/band_filters.h"
#include "sim/acoustics/carriers.h"
#include "sim/acoustics/late_synthesis.h"
#include "sim/audio/ambisonics.h"
#include "sim/audio/fft.h"
#include "sim/audio/spectrum_math.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

using Complex = std::complex<float>;

/// Longest carrier loop: 4 s at 16 kHz.  A longer response repeats it; making longer ones would take more time than they are worth.
constexpr int kMaxCarrierLength = 1 << 16;
/// Delays this close to a whole sample count as whole: an unfiltered arrival then is one sample exactly.
constexpr double kWholeSample = 1e-5;

int count_samples(const AcousticConfig& config) {
  return std::max(1, static_cast<int>(std::lround(static_cast<double>(config.rir_length_s) * config.sample_rate_hz)));
}

/// Room for a different stretch of noise for each source, and loops that a power-of-two transform can make.
int carrier_length(int num_samples) {
  return std::min(kMaxCarrierLength, next_power_of_two(std::max(num_samples + num_samples / 4, 4096)));
}

/// The FFT size at which filtering `num_samples` with `taps` costs least, by overlap-add.
int choose_block_fft(int num_samples, int taps) {
  int best = 0;
  double lowest = 0;
  for (int size = next_power_of_two(2 * taps); size <= std::max(1 << 17, next_power_of_two(2 * taps)); size *= 2) {
    const int blocks = (num_samples + size - taps) / (size - taps + 1);
    const double cost = blocks * static_cast<double>(size) * std::log2(size);
    if (best == 0 || cost < lowest) best = size, lowest = cost;
  }
  return best;
}

/// Adds the circular response to `target` with its sample `zero` at sample `at`: samples up to half a turn before `zero` lie before it.
void add_circular(std::span<const float> response, int zero, std::int64_t at, std::span<float> target) {
  const auto size = static_cast<std::int64_t>(response.size()), length = static_cast<std::int64_t>(target.size());
  const std::int64_t first = at - size / 2;  // target sample of the earliest one
  const std::int64_t begin = std::max<std::int64_t>(0, -first), end = std::min(size, length - first);
  // The response is cut at `seam` where its index wraps.
  const std::int64_t start = ((zero - size / 2) % size + size) % size, seam = size - start;
  for (std::int64_t i = begin; i < std::min(end, seam); ++i)
    target[static_cast<std::size_t>(first + i)] += response[static_cast<std::size_t>(start + i)];
  for (std::int64_t i = std::max(begin, seam); i < end; ++i)
    target[static_cast<std::size_t>(first + i)] += response[static_cast<std::size_t>(i - seam)];
}

}  // namespace

class SynthesisTables {
 public:
  SynthesisTables(const AcousticConfig& config, const BandLayout& bands, ChannelLayout channel_layout, std::shared_ptr<const Hrtf> head)
      : layout(channel_layout),
        hrtf(std::move(head)),
        sample_rate_hz(config.sample_rate_hz),
        num_samples(count_samples(config)),
        num_bands(bands.size()),
        seed(config.seed),
        early_fft(hrtf ? hrtf->fft_size() : next_power_of_two(static_cast<int>(std::ceil(0.02 * config.sample_rate_hz)))),
        filters(bands, config.sample_rate_hz, early_fft),
        carriers(bands, config.sample_rate_hz, hrtf ? 4 : 1, carrier_length(num_samples), config.seed) {
    if (!hrtf) return;
    // The decoder's taps at the FFT size of the late part.
    late_fft = choose_block_fft(num_samples, hrtf->decoder_taps());
    RealFft short_fft(early_fft), long_fft(late_fft);
    std::vector<float> taps(static_cast<std::size_t>(early_fft));
    for (std::size_t c = 0; c < 4; ++c) {
      for (std::size_t ear = 0; ear < 2; ++ear) {
        short_fft.inverse(hrtf->diffuse_decoder(static_cast<int>(c), static_cast<int>(ear)), taps);
        auto& spectrum = decoder[2 * c + ear];
        spectrum.resize(static_cast<std::size_t>(long_fft.num_bins()));
        long_fft.forward(std::span(taps).first(static_cast<std::size_t>(hrtf->decoder_taps())), spectrum);
      }
    }
  }

  ChannelLayout layout;
  std::shared_ptr<const Hrtf> hrtf;  ///< null for mono
  float sample_rate_hz;
  int num_samples, num_bands;
  std::uint64_t seed;
  int early_fft, late_fft = 4;
  BandFilters filters;
  CarrierBank carriers;
  std::array<std::vector<Complex>, 8> decoder;  ///< [channel * 2 + ear][late_fft / 2 + 1]
};

std::shared_ptr<const SynthesisTables> make_synthesis_tables(const AcousticConfig& config, const BandLayout& bands, ChannelLayout layout,
                                                             std::shared_ptr<const Hrtf> hrtf) {
  require(config.sample_rate_hz >= 8000.f && config.sample_rate_hz <= 96000.f, "sample_rate_hz", config.sample_rate_hz,
          "must be in [8000, 96000]");
  require(config.rir_length_s > 0 && config.rir_length_s <= 60, "rir_length_s", config.rir_length_s, "must be in (0, 60]");
  if (layout == ChannelLayout::mono) return std::make_shared<const SynthesisTables>(config, bands, layout, nullptr);
  if (!hrtf) hrtf = Hrtf::rigid_sphere(config.sample_rate_hz);
  require(hrtf->sample_rate_hz() == config.sample_rate_hz, "sample_rate_hz", config.sample_rate_hz, "must be that of the HRTF");
  return std::make_shared<const SynthesisTables>(config, bands, layout, std::move(hrtf));
}

struct RirSynthesizer::Scratch {
  explicit Scratch(const SynthesisTables& tables)
      : early_fft(tables.early_fft),
        late_fft(tables.late_fft),
        late(tables.sample_rate_hz),
        gain(tables.filters.num_bins()),
        response(static_cast<std::size_t>(tables.early_fft)) {
    for (auto& spectrum : ear) spectrum.resize(gain.size());
    if (!tables.hrtf) return;
    const auto bins = static_cast<std::size_t>(late_fft.num_bins());
    for (auto& channel : field) channel.resize(static_cast<std::size_t>(tables.num_samples));
    for (auto& spectrum : field_spectrum) spectrum.resize(bins);
    ear_spectrum.resize(bins);
    block.resize(static_cast<std::size_t>(tables.late_fft));
  }

  RealFft early_fft, late_fft;
  LateSynthesizer late;
  std::vector<float> gain;      ///< of one arrival, per bin
  std::vector<float> response;  ///< of one arrival at one ear
  std::array<std::vector<Complex>, 2> ear;
  std::array<std::vector<float>, 4> field;  ///< late sound in N3D channels, world axes, then head axes
  std::array<std::vector<Complex>, 4> field_spectrum;
  std::vector<Complex> ear_spectrum;
  std::vector<float> block;
};

RirSynthesizer::RirSynthesizer(std::shared_ptr<const SynthesisTables> tables)
    : tables_(std::move(tables)), scratch_(std::make_unique<Scratch>(*tables_)) {}
RirSynthesizer::~RirSynthesizer() = default;
RirSynthesizer::RirSynthesizer(RirSynthesizer&&) noexcept = default;

namespace {

bool all_equal(std::span<const float> values) {
  return std::all_of(values.begin(), values.end(), [&](float value) { return value == values[0]; });
}

}  // namespace

void RirSynthesizer::add_arrival(const Arrival& arrival, double delay_samples, double heading_rad, Rir& rir) {
  const SynthesisTables& tables = *tables_;
  Scratch& scratch = *scratch_;
  if (!(delay_samples >= 0 && delay_samples < tables.num_samples + tables.early_fft / 2)) return;
  const auto amplitude = std::span(arrival.amplitude).first(static_cast<std::size_t>(tables.num_bands));
  if (std::all_of(amplitude.begin(), amplitude.end(), [](float value) { return value == 0.f; })) return;
  const auto whole = std::llround(delay_samples);
  double part = delay_samples - static_cast<double>(whole);
  if (std::abs(part) < kWholeSample) part = 0;
  const auto channel = [&](int index) {
    return std::span(rir.samples)
        .subspan(static_cast<std::size_t>(index) * static_cast<std::size_t>(tables.num_samples),
                 static_cast<std::size_t>(tables.num_samples));
  };

  const bool flat = all_equal(amplitude);
  if (!tables.hrtf && flat && part == 0) {
    if (whole < tables.num_samples) channel(0)[static_cast<std::size_t>(whole)] += amplitude[0];
    return;
  }
  if (!flat) tables.filters.blend(amplitude, scratch.gain);
  const int num_ears = tables.hrtf ? 2 : 1;
  if (tables.hrtf) {
    tables.hrtf->spectra(to_head_axes(arrival.direction, heading_rad), scratch.ear[0], scratch.ear[1], part);
  } else {
    std::fill(scratch.ear[0].begin(), scratch.ear[0].end(), Complex(1.f));
    delay_spectrum(scratch.ear[0], part, tables.early_fft);
  }
  const int zero = tables.hrtf ? tables.hrtf->lead_samples() : 0;
  for (int ear = 0; ear < num_ears; ++ear) {
    Complex* spectrum = scratch.ear[static_cast<std::size_t>(ear)].data();
    const float* gain = scratch.gain.data();
    const std::size_t bins = scratch.gain.size();
    if (flat)
      for (std::size_t k = 0; k < bins; ++k) spectrum[k] *= amplitude[0];
    else
      for (std::size_t k = 0; k < bins; ++k) spectrum[k] *= gain[k];
    scratch.early_fft.inverse(scratch.ear[static_cast<std::size_t>(ear)], scratch.response);
    add_circular(scratch.response, zero, whole, channel(ear));
  }
}

/// Late sound at the ears: N3D channels in head axes through the decoder, by overlap-add.
void RirSynthesizer::decode_late(std::size_t num_samples, Rir& rir) {
  const SynthesisTables& tables = *tables_;
  Scratch& scratch = *scratch_;
  const auto length = static_cast<std::size_t>(tables.num_samples), lead = static_cast<std::size_t>(tables.hrtf->lead_samples());
  const auto step = static_cast<std::size_t>(tables.late_fft - tables.hrtf->decoder_taps() + 1);
  for (std::size_t begin = 0; begin < num_samples; begin += step) {
    const std::size_t count = std::min(step, num_samples - begin);
    for (std::size_t c = 0; c < 4; ++c)
      scratch.late_fft.forward(std::span(scratch.field[c]).subspan(begin, count), scratch.field_spectrum[c]);
    for (std::size_t ear = 0; ear < 2; ++ear) {
      std::fill(scratch.ear_spectrum.begin(), scratch.ear_spectrum.end(), Complex{});
      for (std::size_t c = 0; c < 4; ++c) multiply_add(scratch.field_spectrum[c], tables.decoder[2 * c + ear], scratch.ear_spectrum);
      scratch.late_fft.inverse(scratch.ear_spectrum, scratch.block);
      // Block sample i belongs at begin + i - lead: the decoder starts that much before time zero.
      const std::size_t used = count + static_cast<std::size_t>(tables.hrtf->decoder_taps()) - 1;
      float* ear_samples = rir.samples.data() + ear * length;
      const std::size_t skipped = lead > begin ? lead - begin : 0;
      const std::size_t end = std::min(used, length + lead - begin);
      for (std::size_t i = skipped; i < end; ++i) ear_samples[begin + i - lead] += scratch.block[i];
    }
  }
}

void RirSynthesizer::render(const EnergyResponse& response, double heading_rad, std::uint64_t carrier_key, Rir& rir) {
  const SynthesisTables& tables = *tables_;
  Scratch& scratch = *scratch_;
  const bool binaural = tables.hrtf != nullptr;
  rir.num_channels = binaural ? 2 : 1;
  rir.num_samples = tables.num_samples;
  rir.sample_rate_hz = tables.sample_rate_hz;
  rir.samples.assign(static_cast<std::size_t>(rir.num_channels) * static_cast<std::size_t>(tables.num_samples), 0.f);
  require(response.late.num_bins() == 0 || response.late.num_bands() == tables.num_bands, "bands of the response",
          response.late.num_bands(), "must be those of the tables");
  require(response.arrivals.empty() || response.speed_of_sound_m_per_s > 0, "speed of sound", response.speed_of_sound_m_per_s,
          "must be set by whoever made the response");

  // Nothing is heard before a direct sound.
  double onset_sample = 0;
  for (const Arrival& arrival : response.arrivals)
    if (arrival.kind == ArrivalKind::direct) onset_sample = std::clamp(delay_in_samples(response, arrival), 0.0, static_cast<double>(tables.num_samples));
  const RandomStream random(tables.seed, Purpose::carrier, static_cast<std::uint32_t>(carrier_key),
                            static_cast<std::uint32_t>(carrier_key >> 32), 1);
  const std::size_t offset = random.below(static_cast<std::uint32_t>(tables.carriers.length()), 0);
  if (binaural) {
    const std::array<std::span<float>, 4> channels = {scratch.field[0], scratch.field[1], scratch.field[2], scratch.field[3]};
    const std::size_t sounding = scratch.late.render(response.late, tables.carriers, offset, onset_sample, channels);
    rotate_channels(heading_rad, sounding);
    decode_late(sounding, rir);
  } else {
    const std::array<std::span<float>, 1> channels = {std::span(rir.samples)};
    scratch.late.render(response.late, tables.carriers, offset, onset_sample, channels);
  }
  for (const Arrival& arrival : response.arrivals) add_arrival(arrival, delay_in_samples(response, arrival), heading_rad, rir);
}

double RirSynthesizer::delay_in_samples(const EnergyResponse& response, const Arrival& arrival) const {
  return static_cast<double>(arrival.distance_m) / response.speed_of_sound_m_per_s * tables_->sample_rate_hz;
}

/// World to head axes: a turn about the vertical mixes the two horizontal dipoles (rotate_to_heading for whole signals).
void RirSynthesizer::rotate_channels(double heading_rad, std::size_t num_samples) {
  const auto cosine = static_cast<float>(std::cos(heading_rad)), sine = static_cast<float>(std::sin(heading_rad));
  float *side = scratch_->field[1].data(), *front = scratch_->field[3].data();
  for (std::size_t n = 0; n < num_samples; ++n) {
    const float s = side[n], f = front[n];
    side[n] = cosine * s - sine * f;
    front[n] = cosine * f + sine * s;
  }
}

}  // namespace earshot
