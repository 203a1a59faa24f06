// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/room_responses.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "sim/base/byte_stream.h"
#include "sim/base/coordinates.h"
#include "sim/base/errors.h"

namespace earshot {

void validate(const RoomResponses& room, const std::string& where) {
  const auto refuse = [&](const std::string& problem) {
    return InputError(where, problem, "use a SingleRoomSRIR SOFA file with valid numbers");
  };
  if (!(room.sample_rate_hz >= 1000 && room.sample_rate_hz <= 768000))
    throw refuse(fmt::format("has a sample rate of {} Hz, outside [1000, 768000]", room.sample_rate_hz));
  if (room.responses.empty() || room.responses.size() > RoomResponses::kMaxResponses)
    throw refuse(fmt::format("has {} responses", room.responses.size()));
  if (room.num_samples == 0 || room.num_samples > RoomResponses::kMaxValues / room.responses.size() ||
      room.samples.size() != room.num_samples * room.responses.size())
    throw refuse(fmt::format("has {} samples for {} responses of {}", room.samples.size(), room.responses.size(), room.num_samples));
  for (std::size_t i = 0; i < room.responses.size(); ++i) {
    const RoomResponses::Response& response = room.responses[i];
    for (const glm::dvec3 place : {response.source_m, response.listener_m})
      for (int axis = 0; axis < 3; ++axis)
        if (!(std::abs(place[axis]) <= kMaxCoordinateM)) throw refuse(fmt::format("has a place out of range in response {}", i));
    if (!(std::abs(glm::length(response.source_front) - 1.0) < 1e-6)) throw refuse(fmt::format("has no SourceView in response {}", i));
    if (!(response.delay_samples >= 0 && response.delay_samples <= 1e8))
      throw refuse(fmt::format("has a Data.Delay of {} in response {}, outside [0, 1e8]", response.delay_samples, i));
  }
  const auto bad = std::ranges::find_if(room.samples, [](float sample) { return !std::isfinite(sample); });
  if (bad != room.samples.end())
    throw refuse(fmt::format("has a sample that is not finite in response {}",
                             static_cast<std::size_t>(bad - room.samples.begin()) / room.num_samples));
}

std::string encode_room(const RoomResponses& room) {
  ByteWriter writer;
  writer.put(room.sample_rate_hz);
  writer.put(static_cast<std::uint64_t>(room.num_samples));
  writer.put_list(room.responses);
  writer.put_list(room.samples);
  return writer.take();
}

RoomResponses decode_room(std::string_view bytes, const std::string& where) {
  ByteReader reader(bytes, where);
  RoomResponses room;
  room.sample_rate_hz = reader.take<float>();
  room.num_samples = reader.take<std::uint64_t>();
  room.responses = reader.take_list<RoomResponses::Response>();
  room.samples = reader.take_list<float>();
  reader.finish();
  validate(room, where);
  return room;
}

}  // namespace earshot
