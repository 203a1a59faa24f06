// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <samplerate.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "sim/audio/transforms/resample.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// The library accepts ratios between this and its inverse in one step.
constexpr double kMaxRatio = 256;

std::vector<float> convert(std::span<const float> input, double ratio, const std::string& name, int to_hz) {
  const auto wanted = static_cast<std::size_t>(std::max<std::int64_t>(1, std::llround(static_cast<double>(input.size()) * ratio)));
  std::vector<float> output(wanted + 64, 0.f);
  SRC_DATA data{};
  data.data_in = input.data();
  data.input_frames = static_cast<long>(input.size());
  data.data_out = output.data();
  data.output_frames = static_cast<long>(output.size());
  data.src_ratio = ratio;
  if (const int status = src_simple(&data, SRC_SINC_BEST_QUALITY, 1); status != 0)
    throw InputError(name, fmt::format("cannot be resampled ({})", src_strerror(status)), fmt::format("convert it to {} Hz first", to_hz));
  output.resize(wanted);  // the filter's ringing past the end is not part of the sound
  return output;
}

}  // namespace

std::vector<float> resample(std::span<const float> input, int from_hz, int to_hz, const std::string& name) {
  const double ratio = static_cast<double>(to_hz) / from_hz;
  if (ratio <= kMaxRatio && ratio >= 1 / kMaxRatio) return convert(input, ratio, name, to_hz);
  return convert(convert(input, std::sqrt(ratio), name, to_hz), std::sqrt(ratio), name, to_hz);
}

}  // namespace earshot
