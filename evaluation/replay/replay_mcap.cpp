// SPDX-License-Identifier: Apache-2.0
#include "evaluation/replay/replay_mcap.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string_view>

#include "evaluation/replay/base64.h"
#include "sim/base/text/json.h"
#include "sim/base/version.h"
#include "sim/vision/jpeg_bytes.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);

enum Opcode : std::uint8_t { header = 0x01, footer = 0x02, schema = 0x03, channel = 0x04, message = 0x05, data_end = 0x0F };

/// Fields of a record, little-endian as the format has them.
class Fields {
 public:
  template <class Number>
  Fields& number(Number value) {
    for (std::size_t i = 0; i < sizeof(Number); ++i) bytes_ += static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i) & 0xFFu);
    return *this;
  }
  /// With its length before it.
  Fields& text(std::string_view value) {
    number(static_cast<std::uint32_t>(value.size()));
    bytes_ += value;
    return *this;
  }
  Fields& rest(std::string_view value) {
    bytes_ += value;
    return *this;
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

class McapWriter {
 public:
  McapWriter() : file_(kMagic) { write(header, Fields().text("").text(std::string("earshot ") + kVersion)); }

  /// Channel and schema have this number, from 1 on.
  void add(std::uint16_t number, std::string_view topic, std::string_view name, const Json& properties) {
    const Json described{{"title", name}, {"type", "object"}, {"properties", properties}};
    write(schema, Fields().number(number).text(name).text("jsonschema").text(json_text(described)));
    write(channel, Fields().number(number).number(number).text(topic).text("json").number(std::uint32_t{0}));  // no metadata
  }
  void message_of(std::uint16_t number, std::uint32_t sequence, std::uint64_t time_ns, const Json& value) {
    write(message, Fields().number(number).number(sequence).number(time_ns).number(time_ns).rest(json_text(value)));
  }
  [[nodiscard]] std::string finish() {
    write(data_end, Fields().number(std::uint32_t{0}));                                                  // no checksum
    write(footer, Fields().number(std::uint64_t{0}).number(std::uint64_t{0}).number(std::uint32_t{0}));  // no summary
    file_ += kMagic;
    return std::move(file_);
  }

 private:
  void write(Opcode opcode, const Fields& fields) {
    file_ += static_cast<char>(opcode);
    file_ += Fields().number(static_cast<std::uint64_t>(fields.bytes().size())).bytes();
    file_ += fields.bytes();
  }

  std::string file_;
};

Json numbers_of(std::initializer_list<const char*> names) {
  Json properties = Json::object();
  for (const char* name : names) properties[name] = {{"type", "number"}};
  return properties;
}

const Json& time_schema() {
  static const Json schema_of_time{
      {"type", "object"}, {"title", "time"}, {"properties", {{"sec", {{"type", "integer"}}}, {"nsec", {{"type", "integer"}}}}}};
  return schema_of_time;
}

Json object(const Json& properties) { return {{"type", "object"}, {"properties", properties}}; }

/// 16-bit samples of one step, left and right in turn.
std::string sound_of(const EpisodeRecording& recording, std::size_t step, float gain) {
  const auto count = static_cast<std::size_t>(recording.samples_per_step), all = recording.sound.size() / 2;
  std::vector<std::int16_t> samples;
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t ear = 0; ear < 2; ++ear)
      samples.push_back(
          static_cast<std::int16_t>(std::lround(32767.f * std::clamp(gain * recording.sound[ear * all + step * count + i], -1.f, 1.f))));
  return base64_of<std::int16_t>(samples);
}

Json finite(double value) { return std::isfinite(value) ? Json(value) : Json(); }

}  // namespace

std::string replay_mcap(const EpisodeRecording& recording) {
  McapWriter file;
  const Json text{{"type", "string"}}, bytes{{"type", "string"}, {"contentEncoding", "base64"}};
  const Json pose = object({{"position", object(numbers_of({"x", "y", "z"}))}, {"orientation", object(numbers_of({"x", "y", "z", "w"}))}});
  file.add(1, "/agent", "foxglove.PoseInFrame", {{"timestamp", time_schema()}, {"frame_id", text}, {"pose", pose}});
  file.add(2, "/camera", "foxglove.CompressedImage", {{"timestamp", time_schema()}, {"frame_id", text}, {"data", bytes}, {"format", text}});
  Json audio{{"timestamp", time_schema()}, {"data", bytes}, {"format", text}};
  audio.update(numbers_of({"sample_rate", "number_of_channels"}));
  file.add(3, "/sound", "foxglove.RawAudio", audio);
  file.add(4, "/step", "earshot.Step",
           numbers_of({"step", "action", "reward", "collided", "walk_m", "straight_m", "bearing_rad", "left_db", "right_db", "value"}));

  float peak = 1e-9f;
  for (const float value : recording.sound) peak = std::max(peak, std::fabs(value));
  const double step_ns = std::round(static_cast<double>(recording.env.task.step_time_s) * 1e6) * 1e3;  // whole microseconds
  for (std::size_t i = 0; i < recording.steps.size(); ++i) {
    const RecordedStep& step = recording.steps[i];
    const auto time_ns = static_cast<std::uint64_t>(step_ns * static_cast<double>(i));
    const auto sequence = static_cast<std::uint32_t>(i);
    const Json stamp{{"sec", time_ns / 1000000000u}, {"nsec", time_ns % 1000000000u}};
    const double half = step.pose.heading_rad / 2;
    const Json at{{"x", step.pose.position.x}, {"y", step.pose.position.y}, {"z", step.pose.position.z}};
    const Json turned{{"x", 0}, {"y", std::sin(half)}, {"z", 0}, {"w", std::cos(half)}};
    file.message_of(1, sequence, time_ns,
                    {{"timestamp", stamp}, {"frame_id", "scene"}, {"pose", {{"position", at}, {"orientation", turned}}}});
    file.message_of(2, sequence, time_ns,
                    {{"timestamp", stamp},
                     {"frame_id", "camera"},
                     {"data", base64(jpeg_bytes(recording.config.width_px, recording.config.height_px, step.rgb, kPictureQuality))},
                     {"format", "jpeg"}});
    file.message_of(3, sequence, time_ns,
                    {{"timestamp", stamp},
                     {"data", sound_of(recording, i, 0.89f / peak)},
                     {"format", "pcm-s16"},
                     {"sample_rate", recording.env.acoustics.sample_rate_hz},
                     {"number_of_channels", 2}});
    file.message_of(4, sequence, time_ns,
                    {{"step", i},
                     {"action", i == 0 ? Json() : Json(recording.actions[i - 1])},
                     {"reward", step.reward},
                     {"collided", step.collided ? 1 : 0},
                     {"walk_m", finite(static_cast<double>(step.walk_m))},
                     {"straight_m", step.straight_m},
                     {"bearing_rad", step.bearing_rad},
                     {"left_db", step.level_db[0]},
                     {"right_db", step.level_db[1]},
                     {"value", step.judgement ? finite(step.judgement->value) : Json()}});
  }
  return file.finish();
}

}  // namespace earshot
