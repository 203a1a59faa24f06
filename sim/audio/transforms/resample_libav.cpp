// SPDX-License-Identifier: Apache-2.0
extern "C" {
#include <libavutil/channel_layout.h>
#include <libavutil/opt.h>
#include <libswresample/swresample.h>
}

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>

#include "sim/audio/transforms/resample.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

struct FreeResampler {
  void operator()(SwrContext* context) const noexcept { swr_free(&context); }
};
using Resampler = std::unique_ptr<SwrContext, FreeResampler>;

}  // namespace

std::vector<float> resample(std::span<const float> input, int from_hz, int to_hz, const std::string& name) {
  const auto refuse = [&](const char* problem) { throw InputError(name, problem, fmt::format("convert it to {} Hz first", to_hz)); };
  AVChannelLayout mono;
  av_channel_layout_default(&mono, 1);
  SwrContext* raw = nullptr;
  const int status = swr_alloc_set_opts2(&raw, &mono, AV_SAMPLE_FMT_FLT, to_hz, &mono, AV_SAMPLE_FMT_FLT, from_hz, 0, nullptr);
  const Resampler context{raw};
  if (status < 0) refuse("cannot be resampled");
  // Twice the default filter, passband to 97 % of the lower Nyquist rate, and exact phases: no drift between the two clocks.
  av_opt_set_int(context.get(), "filter_size", 64, 0);
  av_opt_set_double(context.get(), "cutoff", 0.97, 0);
  av_opt_set_int(context.get(), "exact_rational", 1, 0);
  if (swr_init(context.get()) < 0) refuse("cannot be resampled");

  const auto wanted = static_cast<std::size_t>(
      std::max<std::int64_t>(1, std::llround(static_cast<double>(input.size()) * to_hz / static_cast<double>(from_hz))));
  std::vector<float> output(wanted + 4096, 0.f);
  std::size_t written = 0;
  const auto convert = [&](const float* samples, int count) {
    auto* out = reinterpret_cast<std::uint8_t*>(output.data() + written);
    const auto* in = reinterpret_cast<const std::uint8_t*>(samples);
    const int room = static_cast<int>(std::min<std::size_t>(output.size() - written, 1 << 24));
    const int made = swr_convert(context.get(), &out, room, samples ? &in : nullptr, count);
    if (made < 0) refuse("cannot be resampled");
    written += static_cast<std::size_t>(made);
    return made;
  };
  constexpr std::size_t block = 1 << 16;
  for (std::size_t done = 0; done < input.size(); done += block)
    convert(input.data() + done, static_cast<int>(std::min(block, input.size() - done)));
  while (written < output.size() && convert(nullptr, 0) > 0) {
  }
  output.resize(wanted);  // the filter's ringing past the end is not part of the sound
  return output;
}

}  // namespace earshot
