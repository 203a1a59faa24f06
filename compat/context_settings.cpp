// SPDX-License-Identifier: Apache-2.0
#include "compat/context_settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <string_view>

#include "compat/call_error.h"
#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/synthesis/channel_order.h"
#include "sim/base/errors.h"

namespace earshot::compat {
namespace {

constexpr float kSimplifyM = 0.01f;

/// A number of the caller within what the engine takes; a warning names one that is beyond.
int limited(std::size_t value, int least, int most, const char* field, std::vector<std::string>& warnings) {
  const std::size_t clamped = std::clamp(value, static_cast<std::size_t>(least), static_cast<std::size_t>(most));
  if (clamped != value) warnings.push_back(fmt::format("{} = {} is limited to {}", field, value, clamped));
  return static_cast<int>(clamped);
}

void check_number(double value, double least, double most, const char* field) {
  check(value >= least && value <= most, fmt::format("{} = {} is outside [{}, {}]", field, value, least, most));
}

Switch switch_of(bool is_wanted) { return is_wanted ? Switch::automatic : Switch::off; }

std::optional<glm::dquat> hrtf_axes(const RLRA_ContextConfiguration& configuration) {
  glm::dmat3 axes(0);
  constexpr double tolerance = 1e-3;
  for (int i = 0; i < 3; ++i) {  // by value: the fields are packed
    axes[0][i] = static_cast<double>(configuration.hrtfRight[i]);
    axes[1][i] = static_cast<double>(configuration.hrtfUp[i]);
    axes[2][i] = static_cast<double>(configuration.hrtfBack[i]);
  }
  for (int column = 0; column < 3; ++column) {
    const double length = glm::length(axes[column]);
    check(std::isfinite(length) && length > 0, "an axis of the HRTF is zero or not finite; give three orthogonal axes");
    axes[column] /= length;
  }
  const double skew =
      std::max({std::abs(glm::dot(axes[0], axes[1])), std::abs(glm::dot(axes[1], axes[2])), std::abs(glm::dot(axes[2], axes[0]))});
  check(skew < tolerance, "the axes of the HRTF are not orthogonal; give hrtfRight, hrtfUp and hrtfBack at right angles");
  check(glm::dot(glm::cross(axes[0], axes[1]), axes[2]) > 0, "the axes of the HRTF are left-handed; hrtfBack is hrtfRight x hrtfUp");
  if (axes == glm::dmat3(1)) return std::nullopt;
  return glm::normalize(glm::quat_cast(axes));
}

void read_quality(const RLRA_ContextConfiguration& from, AcousticConfig& config, std::vector<std::string>& warnings) {
  check(from.frequencyBands > 0, "frequencyBands = 0; give the number of bands, 4 or 8");
  config.bands = limited(from.frequencyBands, 1, kMaxBands, "frequencyBands", warnings);
  config.sh_order = limited(from.indirectSHOrder, 0, kTracedOrder, "indirectSHOrder", warnings);
  config.rays = limited(from.indirectRayCount, 0, 1 << 24, "indirectRayCount", warnings);
  config.max_bounces = limited(from.indirectRayDepth, 0, 1'000'000, "indirectRayDepth", warnings);
  if (from.maxDiffractionOrder > 0) config.diffraction_order = limited(from.maxDiffractionOrder, 1, 10, "maxDiffractionOrder", warnings);
}

const char* word_of(Switch value) { return value == Switch::automatic ? "auto" : value == Switch::on ? "on" : "off"; }

}  // namespace

EnvironmentSettings read_environment() {
  EnvironmentSettings settings;
  if (const char* seed = std::getenv("EARSHOT_SEED"); seed && *seed) {
    const std::string_view text = seed;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), settings.seed);
    check(error == std::errc() && end == text.data() + text.size(), fmt::format("EARSHOT_SEED is '{}'; write a whole number", text));
  }
  if (const char* preset = std::getenv("EARSHOT_PRESET"); preset && *preset) {
    const std::string text = preset;
    check(text == "fast" || text == "balanced" || text == "high",
          fmt::format("EARSHOT_PRESET is '{}'; write fast, balanced or high", text));
    settings.preset = text;
  }
  return settings;
}

RLRA_ContextConfiguration default_configuration() {
  RLRA_ContextConfiguration configuration;
  std::memset(&configuration, 0, sizeof configuration);
  configuration.thisSize = sizeof configuration;
  configuration.frequencyBands = 4;
  configuration.directSHOrder = 3;
  configuration.indirectSHOrder = 1;
  configuration.directRayCount = 500;
  configuration.indirectRayCount = 5000;
  configuration.indirectRayDepth = 200;
  configuration.sourceRayCount = 200;
  configuration.sourceRayDepth = 10;
  configuration.maxDiffractionOrder = 10;
  configuration.threadCount = 1;
  configuration.sampleRate = 44100.f;
  configuration.maxIRLength = 4.f;
  configuration.unitScale = 1.f;
  configuration.globalVolume = 1.f;
  configuration.hrtfRight[0] = configuration.hrtfUp[1] = configuration.hrtfBack[2] = 1.f;
  configuration.direct = configuration.indirect = configuration.diffraction = configuration.transmission = 1;
  return configuration;
}

ContextSettings read_configuration(const RLRA_ContextConfiguration& from, const EnvironmentSettings& environment) {
  check(from.thisSize == sizeof from,
        fmt::format("thisSize is {} and not {}; begin with RLRA_ContextConfigurationDefault", std::size_t{from.thisSize}, sizeof from));
  ContextSettings settings;
  if (environment.preset) settings.preset = *environment.preset;
  settings.acoustics = acoustic_preset(settings.preset);
  AcousticConfig& config = settings.acoustics;
  if (!environment.preset) read_quality(from, config, settings.warnings);
  config.seed = environment.seed;
  config.threads = limited(from.threadCount, 0, 4096, "threadCount", settings.warnings);
  const float rate_hz = from.sampleRate;
  if (!(rate_hz >= 8000.f && rate_hz <= 96000.f))
    throw CallError(RLRA_InvalidSampleRate, fmt::format("sampleRate = {} is outside [8000, 96000] Hz", rate_hz));
  config.sample_rate_hz = rate_hz;
  check(from.maxIRLength > 0 && from.maxIRLength <= 60, fmt::format("maxIRLength = {} is outside (0, 60] s", float{from.maxIRLength}));
  settings.longest_rir_s = from.maxIRLength;
  config.rir_length_s = 0;
  check_number(static_cast<double>(from.unitScale), 1e-6, 1e6, "unitScale");
  settings.unit_m = static_cast<double>(from.unitScale);
  check(std::isfinite(from.globalVolume), "globalVolume is not finite");
  settings.gain = from.globalVolume;
  settings.hrtf_to_listener = hrtf_axes(from);
  const bool is_indirect = from.indirect != 0;
  config.direct = switch_of(from.direct != 0);
  config.early = config.late = switch_of(is_indirect);
  config.diffraction = switch_of(is_indirect && from.diffraction != 0 && (from.maxDiffractionOrder > 0 || environment.preset));
  config.transmission = switch_of(from.transmission != 0);
  if (from.meshSimplification != 0) settings.simplify_m = kSimplifyM;
  settings.has_temporal_coherence = from.temporalCoherence != 0;
  try {
    validate(config);
  } catch (const InputError& error) {
    throw CallError(RLRA_InvalidParameter, error.what());
  }
  return settings;
}

std::string rir_arguments(const ContextSettings& settings, const AcousticConfig& config) {
  const std::string quality = fmt::format("bands={} sh_order={} rays={} max_bounces={} diffraction_order={} rir_length_s={}", config.bands,
                                          config.sh_order, config.rays, config.max_bounces, config.diffraction_order,
                                          config.rir_length_s == 0 ? "auto" : fmt::format("{}", config.rir_length_s));
  return fmt::format("--preset {} --rate {} --seed {} --gain {} --set {} direct={} early={} late={} diffraction={} transmission={}",
                     settings.preset, config.sample_rate_hz, config.seed, settings.gain, quality, word_of(config.direct),
                     word_of(config.early), word_of(config.late), word_of(config.diffraction), word_of(config.transmission));
}

}  // namespace earshot::compat
