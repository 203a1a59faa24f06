#include "envs/rir_corpus_response.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <span>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

/// Listeners from which on a field is the cheaper way where the plan of a scene has one.
constexpr int kManyListeners = 300;
constexpr double kRadian = 180 / std::numbers::pi;

/// Six digits: what is measured has no more, and lines stay short.
Json rounded(double value) { return std::strtod(fmt::format("{:.6g}", value).c_str(), nullptr); }
Json rounded(const std::optional<double>& value) { return value ? rounded(*value) : Json(nullptr); }
Json place(glm::dvec3 position) { return {position.x, position.y, position.z}; }

template <class Get>
Json per_band(const RoomMetrics& metrics, const Get& get) {
  Json values = Json::array();
  for (const BandMetrics& band : metrics.bands) values.push_back(rounded(get(band)));
  return values;
}

/// Mean over the octaves at 500 Hz and 1 kHz, as ISO 3382-1 states single numbers; null where one of them has none.
Json mid_t20(const RoomMetrics& metrics) {
  double sum = 0;
  int count = 0;
  for (std::size_t b = 0; b < metrics.bands.size(); ++b) {
    if (metrics.bands_hz[b] < 400 || metrics.bands_hz[b] > 1250) continue;
    if (!metrics.bands[b].t20_s) return nullptr;
    sum += *metrics.bands[b].t20_s;
    ++count;
  }
  return count > 0 ? rounded(sum / count) : Json(nullptr);
}

/// What FLAC needs for samples above 1, beside a source: a power of two, so that nothing is rounded.
float gain_for(SoundFormat format, std::span<const float> samples) {
  if (format == SoundFormat::wav) return 1.f;
  float peak = 0;
  for (const float sample : samples) peak = std::max(peak, std::abs(sample));
  float gain = 1.f;
  while (peak * gain >= 1.f) gain *= 0.5f;
  return gain;
}

std::vector<float> scaled(std::span<const float> samples, float gain) {
  std::vector<float> result(samples.begin(), samples.end());
  for (float& sample : result) sample *= gain;
  return result;
}

}  // namespace

std::vector<std::string> channel_names(const ListenerLayout& layout) {
  switch (layout.kind) {
    case ListenerKind::mono:
      return {"mono"};
    case ListenerKind::binaural:
      return {"left", "right"};
    case ListenerKind::ambisonics: {
      std::vector<std::string> names;
      for (int acn = 0; acn < layout.num_channels(); ++acn) names.push_back(fmt::format("acn{}", acn));
      return names;
    }
    case ListenerKind::array:
      break;
  }
  std::vector<std::string> names;
  for (std::size_t i = 0; i < layout.microphones.size(); ++i)
    names.push_back(layout.microphones[i].name.empty() ? fmt::format("mic{}", i) : layout.microphones[i].name);
  return names;
}

CorpusSourceRenderer::CorpusSourceRenderer(const RirCorpusConfig& config, const CorpusRoom& room, std::size_t room_index, int source,
                                           RirSynthesizer& synthesizer)
    : config_(config),
      room_(room),
      room_index_(room_index),
      number_(source),
      synthesizer_(synthesizer),
      source_(room.draw_source(source)),
      candidates_(room.acoustics(), source_.sound) {
  const AcousticScene& acoustics = room.acoustics();
  const bool many = config.acoustics.field == Switch::on || config.listeners_per_source >= kManyListeners;
  if (many && uses_source_field(acoustics)) field_ = build_source_field(acoustics, candidates_);
}

std::string CorpusSourceRenderer::render(int listener, const std::string& folder, std::vector<CorpusFile>& files) {
  const AcousticScene& acoustics = room_.acoustics();
  const Scene& scene = room_.scene();
  const CorpusListener pose = room_.draw_listener(source_, number_, listener);
  const ListenerOrientation orientation = pose.orientation();
  compute_energy_response(acoustics, candidates_, field_.get(), pose.position, response_);
  synthesizer_.render(response_, orientation, CarrierKey(carrier_key(acoustics.hash(), candidates_.source()), pose.position), rir_);
  const RoomMetrics metrics = measure(acoustics, response_);

  const std::string id = fmt::format("{:06}_s{:02}_l{:04}", room_index_, number_, listener);
  const float gain = gain_for(config_.format, rir_.samples);
  std::vector<float> samples = scaled(rir_.samples, gain);
  const auto add = [&](const std::string& suffix, std::span<const float> channels) {
    const std::string name = id + suffix + ending_of(config_.format);
    files.push_back({name, encode_sound(channels, rir_.num_channels, rir_.sample_rate_hz, config_.format, folder + name)});
    return folder + name;
  };

  const glm::dvec3 from = scene.to_world(source_.sound.position), at = scene.to_world(pose.position);
  const glm::vec3 toward = source_.sound.position - pose.position;
  const double distance_m = static_cast<double>(glm::length(toward));
  const glm::vec3 direction = distance_m > 0 ? orientation.world_to_local(glm::normalize(toward)) : glm::vec3(0, 0, -1);
  const bool in_sight = std::ranges::any_of(response_.arrivals, [](const Arrival& a) { return a.kind == ArrivalKind::direct; });
  // Behind a wall the direct sound counts from when the straight line would bring it.
  const double direct_s = distance_m / static_cast<double>(response_.speed_of_sound_m_per_s);

  Json line = {
      {"id", id},
      {"file", add("", samples)},
      {"scene", scene.name()},
      {"scene_hash", hex64(scene.hash())},
      {"room", room_index_},
      {"source", {{"index", number_}, {"position_m", place(from)}, {"heading_deg", source_.heading_deg}, {"pattern", source_.pattern}}},
      {"listener",
       {{"index", listener},
        {"position_m", place(at)},
        {"heading_deg", pose.heading_deg},
        {"pitch_deg", pose.pitch_deg},
        {"roll_deg", pose.roll_deg}}},
      {"distance_m", rounded(distance_m)},
      {"azimuth_deg", rounded(kRadian * std::atan2(static_cast<double>(-direction.x), static_cast<double>(-direction.z)))},
      {"elevation_deg", rounded(kRadian * std::asin(std::clamp(static_cast<double>(direction.y), -1.0, 1.0)))},
      {"line_of_sight", in_sight},
      {"direct_delay_s", rounded(direct_s)},
      {"drr_db", rounded(metrics.drr_db)},
      {"t20_mid_s", mid_t20(metrics)},
      {"t20_s", per_band(metrics, [](const BandMetrics& band) { return band.t20_s; })},
      {"rt60_s", per_band(metrics, [](const BandMetrics& band) { return band.rt60_s; })},
      {"c50_db", per_band(metrics, [](const BandMetrics& band) { return band.c50_db; })},
      {"field_t20_error", field_ ? rounded(field_->t20_error()) : Json(nullptr)},
      {"num_samples", rir_.num_samples},
      {"gain", gain}};
  if (config_.split_ms > 0) {
    const auto frames = static_cast<std::size_t>(rir_.num_samples);
    const double split = (direct_s + 1e-3 * static_cast<double>(config_.split_ms)) * static_cast<double>(rir_.sample_rate_hz);
    const std::size_t first_late = std::min(frames, static_cast<std::size_t>(std::lround(split)));
    std::vector<float> late = samples;
    for (std::size_t channel = 0; channel < static_cast<std::size_t>(rir_.num_channels); ++channel) {
      const auto begin = static_cast<std::ptrdiff_t>(channel * frames), split_at = begin + static_cast<std::ptrdiff_t>(first_late);
      std::fill(late.begin() + begin, late.begin() + split_at, 0.f);
      std::fill(samples.begin() + split_at, samples.begin() + begin + static_cast<std::ptrdiff_t>(frames), 0.f);
    }
    line["split_sample"] = first_late;
    line["early_file"] = add(".early", samples);
    line["late_file"] = add(".late", late);
  }
  return line.dump();
}

}  // namespace earshot
