// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/diffuse_decoder.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/audio/head/ambisonics.h"
#include "sim/audio/transforms/fft.h"
#include "sim/audio/transforms/spectrum_math.h"

namespace earshot {
namespace {

using DoubleComplex = std::complex<double>;

constexpr std::size_t kNumDirections = 2000;
constexpr double kPhaseLimitHz = 1500;
/// Power of a bin over that of the loudest one below it, at which a head counts as silent.
constexpr double kSilence = 1e-12;

/// 2 x 2 complex matrix.
struct Matrix {
  DoubleComplex a, b, c, d;  ///< rows (a b), (c d)
};
Matrix operator*(const Matrix& x, const Matrix& y) {
  return {x.a * y.a + x.b * y.c, x.a * y.b + x.b * y.d, x.c * y.a + x.d * y.c, x.c * y.b + x.d * y.d};
}
Matrix adjoint(const Matrix& x) { return {std::conj(x.a), std::conj(x.c), std::conj(x.b), std::conj(x.d)}; }
DoubleComplex determinant(const Matrix& x) { return x.a * x.d - x.b * x.c; }

/// Lower triangle L with L L^H = the Hermitian matrix x.
Matrix cholesky(const Matrix& x) {
  const double first = std::sqrt(x.a.real());
  const DoubleComplex below = x.c / first;
  return {first, 0, below, std::sqrt(std::max(x.d.real() - std::norm(below), 0.0))};
}
Matrix inverse_of_lower(const Matrix& l) { return {1.0 / l.a, 0, -l.c / (l.a * l.d), 1.0 / l.d}; }

/// Unitary factor of the polar decomposition.  For 2 x 2, x + |det x| x^-H has the singular vectors of x and equal singular values.
Matrix unitary_factor(const Matrix& x) {
  const DoubleComplex det = determinant(x);
  const DoubleComplex turn = std::abs(det) > 0 ? det / std::abs(det) : 1.0;
  const Matrix sum{x.a + turn * std::conj(x.d), x.b - turn * std::conj(x.c), x.c - turn * std::conj(x.b), x.d + turn * std::conj(x.a)};
  const double scale = 1.0 / std::sqrt(std::abs(determinant(sum)));
  return {sum.a * scale, sum.b * scale, sum.c * scale, sum.d * scale};
}

/// Covariance of the two ears from spectra of one bin.
struct Covariance {
  double left = 0, right = 0;
  DoubleComplex cross = 0;  ///< mean of left * conj(right)
  void add(DoubleComplex l, DoubleComplex r) {
    left += std::norm(l);
    right += std::norm(r);
    cross += l * std::conj(r);
  }
  /// As a matrix, with a little independent noise so that a fully coherent pair (low frequencies) can be factored.
  [[nodiscard]] Matrix matrix() const {
    const double noise = 1e-6 * (left + right);
    return {left + noise, cross, std::conj(cross), right + noise};
  }
};

/// Evenly spread directions (spherical Fibonacci points), each with its mirror image, so that a symmetric head gets a symmetric decoder.
std::vector<glm::vec3> spread_directions() {
  std::vector<glm::vec3> directions;
  constexpr std::size_t half = kNumDirections / 2;
  for (std::size_t i = 0; i < half; ++i) {
    const double height = (2.0 * static_cast<double>(i) + 1.0) / half - 1.0, radius = std::sqrt(1.0 - height * height);
    const double angle = 2.0 * std::numbers::pi * std::fmod(static_cast<double>(i) * std::numbers::phi, 1.0);
    const auto x = static_cast<float>(radius * std::cos(angle)), z = static_cast<float>(radius * std::sin(angle));
    directions.push_back({x, static_cast<float>(height), z});
    directions.push_back({-x, static_cast<float>(height), z});
  }
  return directions;
}

/// Cuts a decoder spectrum to `taps` samples from -lead on, faded at both ends, and delays it by the lead.
void cut_to_taps(std::span<std::complex<float>> spectrum, RealFft& fft, int lead_samples, int taps) {
  std::vector<float> response(static_cast<std::size_t>(fft.size())), cut(response.size(), 0.f);
  fft.inverse(spectrum, response);
  const int fade_in = lead_samples / 2, fade_out = (taps - lead_samples) / 2;
  for (int i = 0; i < taps; ++i) {
    const double in = std::min(1.0, (i + 0.5) / fade_in), out = std::min(1.0, (taps - i - 0.5) / fade_out);
    const double weight = std::sin(0.5 * std::numbers::pi * in) * std::sin(0.5 * std::numbers::pi * out);
    cut[static_cast<std::size_t>(i)] =
        static_cast<float>(weight * response[static_cast<std::size_t>((i - lead_samples + fft.size()) % fft.size())]);
  }
  fft.forward(cut, spectrum);
}

}  // namespace

std::array<std::vector<std::complex<float>>, 8> make_diffuse_decoder(const EarSpectra& head, int fft_size, float sample_rate_hz,
                                                                     int lead_samples, int taps) {
  const std::vector<glm::vec3> directions = spread_directions();
  const auto bins = static_cast<std::size_t>(fft_size / 2 + 1);
  std::vector<std::complex<float>> spectra(directions.size() * 2 * bins);  // [direction][ear][bin]
  std::vector<std::array<float, 4>> harmonics(directions.size());
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const auto row = std::span(spectra).subspan(i * 2 * bins, 2 * bins);
    head(directions[i], row.first(bins), row.subspan(bins));
    spherical_harmonics_n3d(directions[i], 1, harmonics[i]);
  }

  std::array<std::vector<std::complex<float>>, 8> decoder;
  for (auto& spectrum : decoder) spectrum.resize(bins);
  std::array<DoubleComplex, 8> before{};
  double loudest = 0;
  for (std::size_t k = 0; k < bins; ++k) {
    const bool phase_free = static_cast<double>(k) * sample_rate_hz / fft_size > kPhaseLimitHz;
    std::array<DoubleComplex, 8> projection{};
    Covariance of_head;
    for (std::size_t i = 0; i < directions.size(); ++i) {
      DoubleComplex ear[2];
      for (std::size_t e = 0; e < 2; ++e) ear[e] = spectra[(i * 2 + e) * bins + k];
      of_head.add(ear[0], ear[1]);
      for (std::size_t e = 0; e < 2; ++e) {
        DoubleComplex target = ear[e];
        if (phase_free) {  // the magnitude of the head with the phase that the decoder already has one bin below
          DoubleComplex decoded = 0;
          for (std::size_t c = 0; c < 4; ++c) decoded += before[2 * c + e] * static_cast<double>(harmonics[i][c]);
          if (std::abs(decoded) > 0) target = std::abs(target) * decoded / std::abs(decoded);
        }
        for (std::size_t c = 0; c < 4; ++c) projection[2 * c + e] += target * static_cast<double>(harmonics[i][c]);
      }
    }
    const double weight = 1.0 / static_cast<double>(directions.size());
    for (DoubleComplex& value : projection) value *= weight;
    before = projection;
    of_head.left *= weight, of_head.right *= weight, of_head.cross *= weight;

    // Above the band of a measured head there is nothing to decode, nor to divide by.
    loudest = std::max(loudest, of_head.left + of_head.right);
    if (!(of_head.left + of_head.right > kSilence * loudest)) continue;

    // N3D channels of a diffuse field are independent and equal in power, so the decoder's covariance is the sum over channels.
    Covariance of_decoder;
    for (std::size_t c = 0; c < 4; ++c) of_decoder.add(projection[2 * c], projection[2 * c + 1]);
    const Matrix have = cholesky(of_decoder.matrix()), want = cholesky(of_head.matrix());
    // Among all mixings that give the wanted covariance, the one that changes the ears least.
    const Matrix mixing = want * adjoint(unitary_factor(adjoint(have) * want)) * inverse_of_lower(have);
    for (std::size_t c = 0; c < 4; ++c) {
      const DoubleComplex left = projection[2 * c], right = projection[2 * c + 1];
      decoder[2 * c][k] = std::complex<float>(mixing.a * left + mixing.b * right);
      decoder[2 * c + 1][k] = std::complex<float>(mixing.c * left + mixing.d * right);
    }
  }
  RealFft fft(fft_size);
  for (auto& spectrum : decoder) cut_to_taps(spectrum, fft, lead_samples, taps);
  return decoder;
}

}  // namespace earshot
