#pragma once

#include <span>
#include <vector>

#include "sim/acoustics/bands.h"

namespace earshot {

/// Weight of band `band` at `frequency_hz`, in [0, 1]; the weights of all bands add up to exactly 1 at every frequency (amplitude-complementary),
/// and so do the squares of their square roots (power-complementary).  Neighbours cross over within a quarter octave on each side of their common
/// edge, as a raised cosine in log f; the lowest band reaches down to 0 Hz, the highest up to half of the sample rate.
float band_weight(const BandLayout& bands, int band, float frequency_hz);

/// Weights at the bins of a real FFT: [num_bands, fft_size / 2 + 1].
std::vector<float> band_weights(const BandLayout& bands, float sample_rate_hz, int fft_size);

}  // namespace earshot
