#include "sim/acoustics/rir_synthesis.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/band_filters.h"
#include "sim/acoustics/carriers.h"
#include "sim/audio/ambisonics.h"
#include "sim/audio/fft.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

using Spectrum = std::vector<std::complex<float>>;

/// First-order field: W, Y, Z, X (ACN).
constexpr int kLateChannels = 4;
/// Binaural carriers: 0 of the directional share, 1 to 4 of the diffuse share of each late channel.
constexpr int kBinauralCarriers = 1 + kLateChannels;

int samples_of(float seconds, float rate_hz) { return std::max(1, static_cast<int>(std::lround(static_cast<double>(seconds) * static_cast<double>(rate_hz)))); }

/// exp(-j w delay) for all bins, by a recurrence in double: one sine and cosine per call.
void multiply_by_delay(std::span<std::complex<float>> spectrum, double delay_samples, int fft_size) {
  const double angle = -2 * std::numbers::pi * delay_samples / fft_size;
  const std::complex<double> step(std::cos(angle), std::sin(angle));
  std::complex<double> turn(1, 0);
  for (auto& bin : spectrum) {
    const auto t = std::complex<float>(turn);
    bin = {bin.real() * t.real() - bin.imag() * t.imag(), bin.real() * t.imag() + bin.imag() * t.real()};
    turn = {turn.real() * step.real() - turn.imag() * step.imag(), turn.real() * step.imag() + turn.imag() * step.real()};
  }
}

}  // namespace

class SynthesisTables {
 public:
  SynthesisTables(const AcousticConfig& config, BandLayout bands, ChannelLayout channel_layout, std::shared_ptr<const Hrtf> head_filters)
      : rate_hz(config.sample_rate_hz),
        num_samples(samples_of(config.rir_length_s, config.sample_rate_hz)),
        layout(channel_layout),
        hrtf(std::move(head_filters)),
        num_bands(bands.size()),
        path_fft_size(hrtf ? hrtf->fft_size() : 512),
        path_weights(band_weights(bands, rate_hz, path_fft_size)),
        carriers(bands, rate_hz, num_samples, layout == ChannelLayout::mono ? 1 : kBinauralCarriers, config.seed) {
    if (layout == ChannelLayout::binaural) make_decoder();
  }

  float rate_hz;
  int num_samples;
  ChannelLayout layout;
  std::shared_ptr<const Hrtf> hrtf;
  int num_bands;
  int path_fft_size;
  std::vector<float> path_weights;   ///< [num_bands, path_fft_size / 2 + 1]
  CarrierBank carriers;
  int late_fft_size = 0;
  std::vector<Spectrum> decoder;     ///< [kLateChannels * 2 + ear], late_fft_size / 2 + 1 bins, the head's lead taken out

 private:
  /// The head's diffuse decoder, from its own FFT size to the one of the late field.
  void make_decoder() {
    late_fft_size = next_power_of_two(num_samples + hrtf->fft_size());
    RealFft small(hrtf->fft_size()), large(late_fft_size);
    std::vector<float> impulse(static_cast<std::size_t>(hrtf->fft_size()));
    for (int channel = 0; channel < kLateChannels; ++channel)
      for (int ear = 0; ear < 2; ++ear) {
        small.inverse(hrtf->diffuse_decoder(channel, ear), impulse);
        Spectrum spectrum(static_cast<std::size_t>(large.num_bins()));
        large.forward(impulse, spectrum);
        multiply_by_delay(spectrum, -hrtf->lead_samples(), late_fft_size);
        decoder.push_back(std::move(spectrum));
      }
  }
};

std::shared_ptr<const SynthesisTables> make_synthesis_tables(const AcousticConfig& config, const BandLayout& bands, ChannelLayout layout, std::shared_ptr<const Hrtf> hrtf) {
  if (layout == ChannelLayout::mono) hrtf.reset();
  require(layout == ChannelLayout::mono || hrtf != nullptr, "hrtf", "none", "binaural sound needs head filters");
  require(!hrtf || hrtf->sample_rate_hz() == config.sample_rate_hz, "hrtf sample rate", hrtf ? hrtf->sample_rate_hz() : 0.f, "must equal sample_rate_hz");
  return std::make_shared<const SynthesisTables>(config, bands, layout, std::move(hrtf));
}

struct RirSynthesizer::Scratch {
  explicit Scratch(const SynthesisTables& tables)
      : path_fft(tables.path_fft_size),
        gain(static_cast<std::size_t>(path_fft.num_bins())),
        path_spectrum{Spectrum(static_cast<std::size_t>(path_fft.num_bins())), Spectrum(static_cast<std::size_t>(path_fft.num_bins()))},
        path_samples(static_cast<std::size_t>(tables.path_fft_size)),
        envelope(static_cast<std::size_t>(tables.num_samples)) {
    if (tables.layout != ChannelLayout::binaural) return;
    late_fft.emplace(tables.late_fft_size);
    for (auto& channel : late) channel.resize(static_cast<std::size_t>(tables.num_samples));
    for (auto& spectrum : late_spectrum) spectrum.resize(static_cast<std::size_t>(late_fft->num_bins()));
    ear_spectrum.resize(static_cast<std::size_t>(late_fft->num_bins()));
    ear_samples.resize(static_cast<std::size_t>(tables.late_fft_size));
  }

  RealFft path_fft;
  std::vector<float> gain;
  std::array<Spectrum, 2> path_spectrum;
  std::vector<float> path_samples, envelope;
  std::optional<RealFft> late_fft;
  std::array<std::vector<float>, kLateChannels> late;
  std::array<Spectrum, kLateChannels> late_spectrum;
  Spectrum ear_spectrum;
  std::vector<float> ear_samples;
};

namespace {

/// Amplitude per sample of one band: square root of the power, which is linear between bin centres, so that its sum over samples is the energy.  Before the first centre and
/// behind the last it is held.
void band_envelope(const EnergyHistogram& late, int band, float rate_hz, std::span<float> envelope) {
  const double bin_samples = static_cast<double>(late.bin_s()) * static_cast<double>(rate_hz);
  const int num_bins = late.num_bins();
  const auto density = [&](int bin) { return late.energy(std::clamp(bin, 0, num_bins - 1), band) / static_cast<float>(bin_samples); };
  std::size_t n = 0;
  for (int bin = -1; bin < num_bins && n < envelope.size(); ++bin) {
    const double begin = (bin + 0.5) * bin_samples, end = begin + bin_samples;
    const float low = density(bin), slope = (density(bin + 1) - low) / static_cast<float>(bin_samples);
    // Sample n covers [n, n + 1): its middle decides.
    const auto last = std::min(envelope.size(), static_cast<std::size_t>(std::max(0.0, std::ceil(end - 0.5))));
    for (; n < last; ++n) envelope[n] = std::sqrt(std::max(0.f, low + slope * static_cast<float>(static_cast<double>(n) + 0.5 - begin)));
  }
  std::fill(envelope.begin() + static_cast<std::ptrdiff_t>(n), envelope.end(), 0.f);
}

/// What share of one bin's energy is directional, and from where.
struct DirectionalSplit {
  float diffuse = 1;                            ///< amplitude of the diffuse share
  std::array<float, kLateChannels> plane{};      ///< amplitude of the directional share in W, Y, Z, X
};

DirectionalSplit split(std::span<const float> coefficients) {
  DirectionalSplit result;
  const float energy = coefficients[0];
  if (coefficients.size() < 4 || !(energy > 0)) return result;
  // Energy vector (Gerzon): N3D first-order coefficients are sqrt(3) times energy times direction cosines.
  std::array<float, 3> vector{coefficients[1] / energy, coefficients[2] / energy, coefficients[3] / energy};
  const float length = std::sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
  if (!(length > 1e-6f)) return result;
  const float share = std::min(1.f, length / std::numbers::sqrt3_v<float>), amplitude = std::sqrt(share);
  result.diffuse = std::sqrt(1.f - share);
  result.plane = {amplitude, amplitude * std::numbers::sqrt3_v<float> * vector[0] / length, amplitude * std::numbers::sqrt3_v<float> * vector[1] / length,
                  amplitude * std::numbers::sqrt3_v<float> * vector[2] / length};
  return result;
}

/// Calls body(first, last, start) for the runs of [0, num_samples) that are contiguous in a circular carrier begun at `offset`.
template <class Body>
void for_each_run(int num_samples, int length, int offset, Body body) {
  for (int first = 0; first < num_samples;) {
    const int start = (offset + first) & (length - 1);
    const int last = std::min(num_samples, first + length - start);
    body(first, last, start);
    first = last;
  }
}

}  // namespace

RirSynthesizer::RirSynthesizer(std::shared_ptr<const SynthesisTables> tables) : tables_(std::move(tables)), scratch_(std::make_unique<Scratch>(*tables_)) {}
RirSynthesizer::~RirSynthesizer() = default;
RirSynthesizer::RirSynthesizer(RirSynthesizer&&) noexcept = default;

void RirSynthesizer::render(const EnergyResponse& response, double heading_rad, std::uint64_t carrier_key, Rir& rir) {
  rir.num_channels = tables_->layout == ChannelLayout::mono ? 1 : 2;
  rir.num_samples = tables_->num_samples;
  rir.sample_rate_hz = tables_->rate_hz;
  rir.samples.assign(static_cast<std::size_t>(rir.num_channels) * static_cast<std::size_t>(rir.num_samples), 0.f);

  const int offset = static_cast<int>(carrier_key & static_cast<std::uint64_t>(tables_->carriers.length() - 1));
  if (response.late.num_bins() > 0) {
    if (tables_->layout == ChannelLayout::mono)
      add_late_mono(response.late, offset, rir);
    else
      add_late_binaural(response.late, heading_rad, offset, rir);
  }
  for (const Arrival& arrival : response.arrivals) add_arrival(arrival, response.speed_of_sound_m_per_s, heading_rad, rir);
}

void RirSynthesizer::add_late_mono(const EnergyHistogram& late, int offset, Rir& rir) {
  Scratch& s = *scratch_;
  for (int band = 0; band < std::min(late.num_bands(), tables_->num_bands); ++band) {
    band_envelope(late, band, tables_->rate_hz, s.envelope);
    const auto carrier = tables_->carriers.carrier(0, band);
    for_each_run(tables_->num_samples, tables_->carriers.length(), offset, [&](int first, int last, int start) {
      const float* w = carrier.data() + start;
      for (int n = first; n < last; ++n) rir.samples[static_cast<std::size_t>(n)] += s.envelope[static_cast<std::size_t>(n)] * w[n - first];
    });
  }
}

void RirSynthesizer::add_late_field(const EnergyHistogram& late, int band, int offset) {
  Scratch& s = *scratch_;
  const CarrierBank& bank = tables_->carriers;
  const double bin_samples = static_cast<double>(late.bin_s()) * static_cast<double>(tables_->rate_hz);
  band_envelope(late, band, tables_->rate_hz, s.envelope);
  for (int bin = 0; bin < late.num_bins(); ++bin) {
    const int begin = static_cast<int>(std::lround(bin * bin_samples));
    const int end = std::min(tables_->num_samples, static_cast<int>(std::lround((bin + 1) * bin_samples)));
    if (begin >= end) break;
    const DirectionalSplit shares = split(late.at(bin, band));
    for_each_run(end - begin, bank.length(), offset + begin, [&](int first, int last, int start) {
      const float* envelope = s.envelope.data() + begin + first;
      const float* directional = bank.carrier(0, band).data() + start;
      for (int channel = 0; channel < kLateChannels; ++channel) {
        const float* diffuse = bank.carrier(1 + channel, band).data() + start;
        const float plane = shares.plane[static_cast<std::size_t>(channel)];
        float* out = s.late[static_cast<std::size_t>(channel)].data() + begin + first;
        for (int n = 0; n < last - first; ++n) out[n] += envelope[n] * (plane * directional[n] + shares.diffuse * diffuse[n]);
      }
    });
  }
}

void RirSynthesizer::add_late_binaural(const EnergyHistogram& late, double heading_rad, int offset, Rir& rir) {
  Scratch& s = *scratch_;
  for (auto& channel : s.late) std::fill(channel.begin(), channel.end(), 0.f);
  for (int band = 0; band < std::min(late.num_bands(), tables_->num_bands); ++band) add_late_field(late, band, offset);

  // Into head axes: a turn to the left moves what was in front to the right (ambisonics.h).
  const auto cosine = static_cast<float>(std::cos(heading_rad)), sine = static_cast<float>(std::sin(heading_rad));
  for (std::size_t n = 0; n < s.late[1].size(); ++n) {
    const float y = s.late[1][n], x = s.late[3][n];
    s.late[1][n] = cosine * y - sine * x;
    s.late[3][n] = cosine * x + sine * y;
  }
  for (std::size_t channel = 0; channel < kLateChannels; ++channel) s.late_fft->forward(s.late[channel], s.late_spectrum[channel]);
  for (int ear = 0; ear < 2; ++ear) {
    std::fill(s.ear_spectrum.begin(), s.ear_spectrum.end(), std::complex<float>{});
    for (std::size_t channel = 0; channel < kLateChannels; ++channel) {
      const Spectrum& filter = tables_->decoder[2 * channel + static_cast<std::size_t>(ear)];
      const Spectrum& field = s.late_spectrum[channel];
      for (std::size_t k = 0; k < field.size(); ++k) {
        // Written out: the operator of std::complex checks for NaN in every product.
        const std::complex<float> a = field[k], b = filter[k];
        s.ear_spectrum[k] += std::complex<float>(a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real());
      }
    }
    s.late_fft->inverse(s.ear_spectrum, s.ear_samples);
    float* out = rir.samples.data() + static_cast<std::ptrdiff_t>(ear) * rir.num_samples;
    for (int n = 0; n < rir.num_samples; ++n) out[n] += s.ear_samples[static_cast<std::size_t>(n)];
  }
}

void RirSynthesizer::add_arrival(const Arrival& arrival, float speed_of_sound_m_per_s, double heading_rad, Rir& rir) {
  Scratch& s = *scratch_;
  const int size = tables_->path_fft_size, num_bins = size / 2 + 1;
  const double delay = static_cast<double>(arrival.distance_m) / static_cast<double>(speed_of_sound_m_per_s) * static_cast<double>(tables_->rate_hz);
  if (!(delay < rir.num_samples)) return;
  const double whole = std::floor(delay);

  std::fill(s.gain.begin(), s.gain.end(), 0.f);
  for (int band = 0; band < tables_->num_bands; ++band) {
    const float amplitude = arrival.amplitude[static_cast<std::size_t>(band)];
    const float* weights = tables_->path_weights.data() + static_cast<std::ptrdiff_t>(band) * num_bins;
    for (int k = 0; k < num_bins; ++k) s.gain[static_cast<std::size_t>(k)] += amplitude * weights[k];
  }
  int lead = 0;
  if (tables_->hrtf) {
    tables_->hrtf->spectra(to_head_axes(arrival.direction, heading_rad), s.path_spectrum[0], s.path_spectrum[1]);
    lead = tables_->hrtf->lead_samples();
  } else {
    std::fill(s.path_spectrum[0].begin(), s.path_spectrum[0].end(), std::complex<float>(1, 0));
  }
  // The zero-phase band filters and the fraction of a sample ring on both sides: a quarter of the buffer lies before the arrival.
  const int before = size / 4;
  const auto first = static_cast<std::ptrdiff_t>(whole) - lead - before;
  for (int ear = 0; ear < rir.num_channels; ++ear) {
    Spectrum& spectrum = s.path_spectrum[static_cast<std::size_t>(ear)];
    for (std::size_t k = 0; k < spectrum.size(); ++k) spectrum[k] *= s.gain[k];
    multiply_by_delay(spectrum, delay - whole + before, size);
    // A real signal has a real value at half of the sample rate; the fractional delay leaves its cosine there.
    spectrum.back() = spectrum.back().real();
    s.path_fft.inverse(spectrum, s.path_samples);
    float* out = rir.samples.data() + static_cast<std::ptrdiff_t>(ear) * rir.num_samples;
    const std::ptrdiff_t from = std::max<std::ptrdiff_t>(0, -first), to = std::min<std::ptrdiff_t>(size, rir.num_samples - first);
    for (std::ptrdiff_t i = from; i < to; ++i) out[first + i] += s.path_samples[static_cast<std::size_t>(i)];
  }
}

}  // namespace earshot
