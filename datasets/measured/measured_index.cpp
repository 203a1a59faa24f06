// SPDX-License-Identifier: Apache-2.0
#include "datasets/measured/measured_index.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>

#include "datasets/corpus_sounds.h"
#include "datasets/measured/measured_room.h"
#include "sim/acoustics/metrics/onset.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

/// Energy of the direct sound.
double direct_energy(std::span<const float> samples, double rate_hz, double delay_s) {
  constexpr double window_s = 2.5e-3;
  const auto at = [&](double time_s) {
    return static_cast<std::size_t>(std::clamp(std::round(time_s * rate_hz), 0.0, static_cast<double>(samples.size())));
  };
  double sum = 0;
  for (std::size_t i = at(delay_s - window_s); i < at(delay_s + window_s); ++i) sum += double{samples[i]} * double{samples[i]};
  return sum;
}

/// Reads times, level and ratios off the first channel.
void measure_into(const SoundChannels& sound, std::optional<double> direct_delay_s, const std::string& where, IndexedResponse& response) {
  const std::span<const float> first = sound.channel(0);
  const double rate_hz = sound.sample_rate_hz;
  const std::optional<std::size_t> onset = find_onset(first, rate_hz);
  if (!onset) throw InputError(where, "is silent", "leave it out");
  response.direct_delay_s = direct_delay_s ? *direct_delay_s : static_cast<double>(*onset) / rate_hz;
  const double direct = direct_energy(first, rate_hz, response.direct_delay_s);
  if (!(direct > 0)) throw InputError(where, "has no direct sound at its time", "correct direct_delay_s, or leave it out");
  response.gain = std::sqrt(direct) * 4 * std::numbers::pi * std::max(response.distance_m, 0.1);
  RirMeasurement how{.direct_delay_s = response.direct_delay_s};
  how.without_noise = true;
  const RoomMetrics metrics = measure(first, sound.sample_rate_hz, how);
  response.drr_db = metrics.drr_db.value_or(std::numeric_limits<double>::quiet_NaN());
  double sum = 0;
  int count = 0;
  for (std::size_t b = 0; b < metrics.bands.size(); ++b)
    if (metrics.bands_hz[b] > 400 && metrics.bands_hz[b] < 1200 && metrics.bands[b].t20_s) sum += *metrics.bands[b].t20_s, ++count;
  response.t20_mid_s = count == 2 ? sum / count : std::numeric_limits<double>::quiet_NaN();
}

std::string labels_of(const IndexedResponse& response) {
  return json_text(Json{{"response", response.id},
                        {"scene", nullptr},
                        {"room", response.room},
                        {"source", response.source},
                        {"distance_m", response.distance_m},
                        {"azimuth_deg", nullptr},
                        {"elevation_deg", nullptr},
                        {"line_of_sight", nullptr},
                        {"direct_delay_s", response.direct_delay_s},
                        {"drr_db", number(response.drr_db)},
                        {"t20_mid_s", number(response.t20_mid_s)}});
}

/// Adds one file; the others of the room and of its source are known to the caller.
void add(const fs::path& folder, IndexedResponse response, std::optional<double> direct_delay_s, MeasuredIndex& index) {
  const std::string where = (folder / response.file).string();
  const SoundChannels sound = load_sound_channels(where);
  if (index.channels.empty()) {
    index.sample_rate_hz = sound.sample_rate_hz;
    for (int c = 0; c < sound.num_channels; ++c) index.channels.push_back(std::to_string(c));
  }
  if (static_cast<std::size_t>(sound.num_channels) != index.channels.size() || sound.sample_rate_hz != index.sample_rate_hz)
    throw InputError(where,
                     fmt::format("has {} channels at {:.0f} Hz, files before it have {} at {:.0f} Hz", sound.num_channels,
                                 sound.sample_rate_hz, index.channels.size(), index.sample_rate_hz),
                     "give files that agree, or convert them");
  measure_into(sound, direct_delay_s, where, response);
  response.id = fs::path(response.file).replace_extension().string();
  response.labels = labels_of(response);
  const auto* bytes = reinterpret_cast<const char*>(sound.samples.data());
  index.hash = hash64(
      fmt::format("{} {} {:016x}", index.hash, response.labels, hash64(std::string_view(bytes, sound.samples.size() * sizeof(float)))));
  index.responses.push_back(std::move(response));
}

MeasuredIndex index_places(const fs::path& folder) {
  const MeasuredRoom room = load_measured_room(folder);
  MeasuredIndex index;
  std::map<std::string, int> sources;
  const auto text = [](glm::dvec3 p) { return fmt::format("{:.4f},{:.4f},{:.4f}", p.x, p.y, p.z); };
  for (const MeasuredResponse& measured : room.responses) {
    if (!fs::exists(folder / measured.name))
      throw InputError(measured.name, "is one channel of a file: signals are made of whole files",
                       "write the channel to a file of its own");
    IndexedResponse response;
    response.file = measured.name;
    response.source = sources.try_emplace(text(measured.source_m), static_cast<int>(sources.size())).first->second;
    response.place = text(measured.listener_m);
    response.distance_m = glm::length(measured.listener_m - measured.source_m);
    add(folder, std::move(response), measured.direct_delay_s, index);
  }
  return index;
}

}  // namespace

MeasuredIndex index_measured(const fs::path& folder) {
  if (has_places(folder)) return index_places(folder);
  MeasuredIndex index;
  std::map<std::string, std::size_t> rooms;
  std::map<std::size_t, int> sources;
  for (const std::string& file : SoundFolder::list(folder).files) {
    IndexedResponse response;
    response.file = file;
    response.room = rooms.try_emplace(fs::path(file).parent_path().string(), rooms.size()).first->second;
    response.source = sources[response.room]++;
    response.place = file;
    response.distance_m = 1;
    add(folder, std::move(response), std::nullopt, index);
  }
  return index;
}

}  // namespace earshot
