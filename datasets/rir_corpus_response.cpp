// SPDX-License-Identifier: Apache-2.0
#include "datasets/rir_corpus_response.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <iterator>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <span>

#include "datasets/inputs/wished_rooms.h"
#include "datasets/labels/label_number.h"
#include "datasets/labels/response_labels.h"
#include "sim/acoustics/source_field/field_for_poses.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kRadian = 180 / std::numbers::pi;
/// What FLAC needs for samples above 1, beside a source: a power of two, so that nothing is rounded.
float gain_for(SoundFormat format, std::span<const float> samples) {
  if (format == SoundFormat::wav) return 1.f;
  float peak = 0;
  for (const float sample : samples) peak = std::max(peak, std::abs(sample));
  float gain = 1.f;
  while (peak * gain >= 1.f) gain *= 0.5f;
  return gain;
}

/// To the axes of SOFA: x ahead, y to the left, z up.
glm::dvec3 sofa_axes(glm::dvec3 v) { return {-v.z, -v.x, v.y}; }

/// Receivers as the layout has them, of which the comment of harmonics says more; ears where the rigid sphere of hrtf.h has them, as files
/// of measured heads do not say.
void describe_receivers(const ListenerLayout& layout, SofaRoomResponses& sofa) {
  if (layout.kind == ListenerKind::ambisonics) {
    sofa.harmonics = true;
    sofa.comment +=
        fmt::format("; spherical harmonics to order {} by ACN, {}, in the axes of the {}", layout.order,
                    layout.norm == HarmonicNorm::n3d ? "N3D" : "SN3D", layout.axes == HarmonicAxes::world ? "room" : "listener");
  } else if (layout.kind == ListenerKind::binaural) {
    constexpr double radius_m = 0.0875, ear_rad = 100 * std::numbers::pi / 180;
    for (const double side : {1.0, -1.0})
      sofa.receivers.push_back({.position = radius_m * glm::dvec3(std::cos(ear_rad), side * std::sin(ear_rad), 0),
                                .view = {std::cos(ear_rad), side * std::sin(ear_rad), 0},
                                .up = {0, 0, 1}});
  } else if (layout.kind == ListenerKind::array) {
    for (const Microphone& microphone : layout.microphones)
      sofa.receivers.push_back({.position = sofa_axes(microphone.position_m),
                                .view = sofa_axes(microphone.orientation * glm::vec3(0, 0, -1)),
                                .up = sofa_axes(microphone.orientation * glm::vec3(0, 1, 0))});
  } else {
    sofa.receivers.push_back({});
  }
}

SofaRoomResponses describe_sofa(const RirCorpusConfig& config, const Scene& scene, const CorpusSource& source) {
  const ListenerLayout layout = ListenerLayout::named(config.channels);
  SofaRoomResponses sofa;
  sofa.title = "room impulse responses of " + scene.name();
  sofa.room_description = scene.name() + ", hash " + hex64(scene.hash());
  sofa.listener_description = config.channels;
  sofa.comment = "pressure of a source of 1/(4 pi r) at 1 m, sample n at time n / rate after emission";
  sofa.sample_rate_hz = config.acoustics.sample_rate_hz;
  sofa.num_receivers = layout.num_channels();
  sofa.source = {.position = sofa_axes(scene.to_world(source.sound.position)),
                 .view = sofa_axes(source.sound.orientation * glm::vec3(0, 0, -1)),
                 .up = sofa_axes(source.sound.orientation * glm::vec3(0, 1, 0))};
  describe_receivers(layout, sofa);
  if (scene.name().starts_with("shoebox:"))
    sofa.shoebox = {sofa_axes(scene.to_world(scene.bounds().lower)), sofa_axes(scene.to_world(scene.bounds().upper))};
  sofa.temperature_k = 273.15 + static_cast<double>(scene.air().temperature_c);
  return sofa;
}

std::vector<float> scaled(std::span<const float> samples, float gain) {
  std::vector<float> result(samples.begin(), samples.end());
  for (float& sample : result) sample *= gain;
  return result;
}

}  // namespace

std::vector<std::shared_ptr<const SynthesisTables>> corpus_tables(const RirCorpusConfig& config) {
  const ListenerLayout layout = ListenerLayout::named(config.channels);
  const float rate_hz = config.acoustics.sample_rate_hz;
  std::vector<std::string> heads = config.hrtfs;
  if (heads.empty()) heads.push_back(config.hrtf.empty() ? "sphere" : config.hrtf);
  std::vector<std::shared_ptr<const SynthesisTables>> tables;
  for (const std::string& name : heads) {
    std::shared_ptr<const Hrtf> head;
    if (layout.kind == ListenerKind::binaural) head = name == "sphere" ? Hrtf::rigid_sphere(rate_hz) : Hrtf::from_sofa(name, rate_hz);
    tables.push_back(make_synthesis_tables(config.acoustics, bands_of(config.acoustics), layout, head));
  }
  return tables;
}

CorpusSourceRenderer::CorpusSourceRenderer(const RirCorpusConfig& config, const CorpusRoom& room, std::size_t room_index, int source,
                                           std::span<RirSynthesizer> heads)
    : config_(config),
      room_(room),
      room_index_(room_index),
      number_(source),
      heads_(heads),
      source_(room.draw_source(source)),
      candidates_(room.acoustics(), source_.sound),
      places_(room.acoustics()) {
  const AcousticScene& acoustics = room.acoustics();
  field_ = field_for_poses(acoustics, candidates_, static_cast<std::size_t>(config.listeners_per_source));
  if (config.sofa) sofa_ = describe_sofa(config, room.scene(), source_);
}

std::string CorpusSourceRenderer::sofa_name() const { return fmt::format("{:06}_s{:02}.sofa", room_index_, number_); }

struct CorpusSourceRenderer::Recording {
  int listener = 0;
  CorpusListener pose;
  std::string id;
  const std::string& folder;
  std::vector<CorpusFile>& files;
  double direct_s = 0;
  Json line;
};

std::string CorpusSourceRenderer::render(int listener, const std::string& folder, std::vector<CorpusFile>& files) {
  const std::uint64_t room_hash = room_.acoustics().hash();
  Recording recording{.listener = listener,
                      .pose = hear(listener),
                      .id = fmt::format("{:06}_s{:02}_l{:04}", room_index_, number_, listener),
                      .folder = folder,
                      .files = files,
                      .line = Json::object()};
  const CorpusListener& pose = recording.pose;
  recording.direct_s = direct_delay_s(source_.sound.position, pose.position, response_);
  heads_[pose.head].render(response_, pose.orientation(), CarrierKey(carrier_key(room_hash, candidates_.source()), pose.position), rir_);
  const float gain = gain_for(config_.format, rir_.samples);
  std::vector<float> samples = scaled(rir_.samples, gain);

  Json& line = recording.line;
  line["id"] = recording.id;
  line["file"] = store(recording, "", samples);
  label_geometry(recording);
  add_metrics(room_.acoustics(), response_, field_.get(), line);
  if (config_.stated_errors) add_errors(room_.acoustics(), candidates_, field_.get(), pose.position, response_, line);
  line["num_samples"] = rir_.num_samples;
  line["gain"] = gain;
  add_pictures(recording);
  if (config_.sofa) line["measurement"] = sofa_.listeners.size() - 1;
  if (config_.split_ms > 0) store_split(recording, samples);
  return json_text(line);
}

CorpusListener CorpusSourceRenderer::hear(int listener) {
  const auto hear_at = [&](std::uint32_t redraw) {
    CorpusListener pose = room_.draw_listener(source_, number_, listener, redraw);
    static_cast<void>(places_.check({"source", source_.sound.position}, {"listener", pose.position}));
    compute_energy_response(room_.acoustics(), candidates_, field_.get(), pose.position, response_);
    return pose;
  };
  const WishedListener wished(config_, room_index_, number_, listener);
  if (!wished.is_asked()) return hear_at(0);
  WishedDraw draw;
  while (draw.wants_more(WishedListener::kMostDraws)) {
    const CorpusListener pose = hear_at(draw.next());
    if (draw.judge(wished.miss(room_.acoustics(), response_)) == 0) return pose;
  }
  if (!draw.best())
    throw InputError(room_.scene().name(),
                     fmt::format("has no listener of source {} with {} in {} draws", number_, wished.text(), WishedListener::kMostDraws),
                     "widen the ranges, or draw more and other rooms");
  return hear_at(*draw.best());
}

std::string CorpusSourceRenderer::store(Recording& recording, const std::string& suffix, std::span<const float> channels) {
  if (config_.sofa) {
    // Harmonics in the axes of the room are those of a listener who looks along them.
    const ListenerLayout layout = ListenerLayout::named(config_.channels);
    const bool turned = layout.kind != ListenerKind::ambisonics || layout.axes == HarmonicAxes::ego;
    const ListenerOrientation facing = turned ? recording.pose.orientation() : ListenerOrientation();
    sofa_.num_samples = rir_.num_samples;
    sofa_.samples.insert(sofa_.samples.end(), channels.begin(), channels.end());
    sofa_.listeners.push_back({.position = sofa_axes(room_.scene().to_world(recording.pose.position)),
                               .view = sofa_axes(facing.local_to_world(glm::vec3(0, 0, -1))),
                               .up = sofa_axes(facing.local_to_world(glm::vec3(0, 1, 0)))});
    return recording.folder + sofa_name();
  }
  const std::string name = recording.id + suffix + ending_of(config_.format);
  recording.files.push_back(
      {name, encode_sound(channels, rir_.num_channels, rir_.sample_rate_hz, config_.format, recording.folder + name, rir_.channel_mask)});
  return recording.folder + name;
}

void CorpusSourceRenderer::label_geometry(Recording& recording) const {
  const Scene& scene = room_.scene();
  const CorpusListener& pose = recording.pose;
  const glm::vec3 toward = source_.sound.position - pose.position;
  const double distance_m = static_cast<double>(glm::length(toward));
  const glm::vec3 direction = distance_m > 0 ? pose.orientation().world_to_local(glm::normalize(toward)) : glm::vec3(0, 0, -1);

  Json& line = recording.line;
  line["scene"] = scene.name();
  line["scene_hash"] = hex64(scene.hash());
  line["room"] = room_index_;
  line["source"] = {{"index", number_},
                    {"position_m", place_label(scene.to_world(source_.sound.position))},
                    {"heading_deg", source_.heading_deg},
                    {"pattern", source_.pattern}};
  line["listener"] = {{"index", recording.listener},
                      {"position_m", place_label(scene.to_world(pose.position))},
                      {"heading_deg", pose.heading_deg},
                      {"pitch_deg", pose.pitch_deg},
                      {"roll_deg", pose.roll_deg}};
  if (!config_.hrtfs.empty()) line["listener"]["hrtf"] = config_.hrtfs[pose.head];
  line["distance_m"] = rounded(distance_m);
  line["azimuth_deg"] = rounded(kRadian * std::atan2(static_cast<double>(-direction.x), static_cast<double>(-direction.z)));
  line["elevation_deg"] = rounded(kRadian * std::asin(std::clamp(static_cast<double>(direction.y), -1.0, 1.0)));
  line["line_of_sight"] = is_in_sight(response_);
  line["direct_delay_s"] = rounded_delay(recording.direct_s);
}

void CorpusSourceRenderer::add_pictures(Recording& recording) const {
  const CorpusPictures* pictures = room_.pictures();
  if (!pictures) return;
  const CorpusListener& pose = recording.pose;
  std::vector<CorpusFile> made = pictures->render(room_.scene(), pose.position, pose.heading_deg / kRadian, recording.id);
  recording.line["rgb_file"] = recording.folder + made[0].name;
  recording.line["depth_file"] = recording.folder + made[1].name;
  recording.line["category_file"] = recording.folder + made[2].name;
  std::ranges::move(made, std::back_inserter(recording.files));
}

void CorpusSourceRenderer::store_split(Recording& recording, std::vector<float>& samples) {
  const auto frames = static_cast<std::size_t>(rir_.num_samples);
  const double split = (recording.direct_s + 1e-3 * static_cast<double>(config_.split_ms)) * static_cast<double>(rir_.sample_rate_hz);
  const std::size_t first_late = std::min(frames, static_cast<std::size_t>(std::lround(split)));
  std::vector<float> late = samples;
  for (std::size_t channel = 0; channel < static_cast<std::size_t>(rir_.num_channels); ++channel) {
    const auto begin = static_cast<std::ptrdiff_t>(channel * frames), split_at = begin + static_cast<std::ptrdiff_t>(first_late);
    std::fill(late.begin() + begin, late.begin() + split_at, 0.f);
    std::fill(samples.begin() + split_at, samples.begin() + begin + static_cast<std::ptrdiff_t>(frames), 0.f);
  }
  recording.line["split_sample"] = first_late;
  recording.line["early_file"] = store(recording, ".early", samples);
  recording.line["late_file"] = store(recording, ".late", late);
}

}  // namespace earshot
