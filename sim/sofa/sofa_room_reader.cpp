// SPDX-License-Identifier: Apache-2.0
#include "sim/sofa/sofa_room_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

#include "sim/audio/measured/listener_frame.h"
#include "sim/sofa/sofa_pose.h"
#include "sim/sofa/sofa_variables.h"

namespace earshot {
namespace {

glm::dvec3 scene_axes(glm::dvec3 v) { return {-v.y, v.z, -v.x}; }

float sample_rate_hz(const SofaFile& file) {
  const SofaVariable rate = file.get("Data.SamplingRate");
  if (!rate.units.empty() && rate.units != "hertz" && rate.units != "hz")
    throw file.refuse(fmt::format("has a Data.SamplingRate in '{}' instead of hertz", rate.units));
  if (std::ranges::any_of(rate.values, [&](double value) { return value != rate.values[0]; }))
    throw file.refuse("has measurements of different sampling rates");
  return static_cast<float>(rate.values[0]);
}

/// Data.Delay [I or M][R] in samples; 0 where the file has none.
class Delays {
 public:
  Delays(const SofaFile& file, std::size_t measurements, std::size_t receivers) : variable_(file.find("Data.Delay")) {
    if (!variable_) return;
    const std::vector<std::size_t>& size = variable_->size;
    if (size.size() != 2 || (size[0] != 1 && size[0] != measurements) || (size[1] != 1 && size[1] != receivers))
      throw file.refuse(
          fmt::format("has Data.Delay of {} instead of 1 x R or M x R = {} x {}", variable_->shape(), measurements, receivers));
  }
  [[nodiscard]] double at(std::size_t measurement, std::size_t receiver) const {
    if (!variable_) return 0;
    const std::size_t m = variable_->size[0] == 1 ? 0 : measurement, r = variable_->size[1] == 1 ? 0 : receiver;
    return variable_->values[m * variable_->size[1] + r];
  }

 private:
  std::optional<SofaVariable> variable_;
};

/// Where the microphones of a listener are.
class Microphones {
 public:
  Microphones(const SofaFile& file, std::size_t measurements) : count_(0) {
    const SofaVariable position = file.get("ReceiverPosition");
    if (position.size.empty()) throw file.refuse("has one number in ReceiverPosition");
    count_ = position.size[0];
    if (position.type == "spherical harmonics")
      harmonics_ = true;
    else
      receivers_.emplace(file, measurements);
  }
  [[nodiscard]] std::size_t in_file() const { return count_; }
  [[nodiscard]] std::size_t read() const { return harmonics_ ? 1 : count_; }
  [[nodiscard]] glm::dvec3 at(std::size_t receiver, std::size_t measurement) const {
    return harmonics_ ? glm::dvec3(0) : receivers_->at(receiver, measurement);
  }

 private:
  std::size_t count_;
  bool harmonics_ = false;
  std::optional<SofaReceivers> receivers_;
};

}  // namespace

RoomResponses read_sofa_room(const std::filesystem::path& path) {
  const SofaFile file(path, "use a SingleRoomSRIR SOFA file", RoomResponses::kMaxValues);
  require_convention(file, {"SingleRoomSRIR", "SingleRoomDRIR"}, "responses in one room", "FIR");
  require_emitter_at_source(file);
  const SofaVariable data = file.get("Data.IR");
  if (data.size.size() != 3) throw file.refuse(fmt::format("has Data.IR of {} instead of M x R x N", data.shape()));
  for (std::size_t i = 0; i < 3; ++i)
    if (data.dimensions[i] != '?' && data.dimensions[i] != "MRN"[i] && data.size[i] != 1)
      throw file.refuse(fmt::format("has Data.IR with dimensions {} instead of MRN", data.dimensions));
  const std::size_t measurements = data.size[0];
  const Microphones microphones(file, measurements);
  if (data.size[1] != microphones.in_file())
    throw file.refuse(fmt::format("has Data.IR of {} for {} receivers", data.shape(), microphones.in_file()));
  const SofaPose listener(file, "ListenerPosition", {0, 0, 0}, measurements), listener_view(file, "ListenerView", {1, 0, 0}, measurements);
  const SofaPose listener_up(file, "ListenerUp", {0, 0, 1}, measurements, listener_view.type());
  const SofaPose source(file, "SourcePosition", {0, 0, 0}, measurements), view(file, "SourceView", {1, 0, 0}, measurements);
  require_view(file, listener_view, measurements, "ListenerView");
  require_view(file, view, measurements, "SourceView");
  const Delays delays(file, measurements, microphones.in_file());

  RoomResponses room{.sample_rate_hz = sample_rate_hz(file), .num_samples = data.size[2], .responses = {}, .samples = {}};
  for (std::size_t m = 0; m < measurements; ++m) {
    const ListenerFrame frame(glm::dvec3(0), listener_view[m], listener_up[m]);
    // Columns: images of the room's axes in the head; its transpose leads back.
    const glm::dmat3 to_head(frame.to_head({1, 0, 0}), frame.to_head({0, 1, 0}), frame.to_head({0, 0, 1}));
    for (std::size_t r = 0; r < microphones.read(); ++r) {
      const glm::dvec3 local = microphones.at(r, m);
      const glm::dvec3 place = listener[m] + glm::transpose(to_head) * glm::dvec3(-local.y, local.z, -local.x);
      room.responses.push_back({.source_m = scene_axes(source[m]),
                                .listener_m = scene_axes(place),
                                .source_front = glm::normalize(scene_axes(view[m])),
                                .delay_samples = delays.at(m, r)});
      const double* first = &data.values[(m * data.size[1] + r) * data.size[2]];
      std::transform(first, first + data.size[2], std::back_inserter(room.samples), [](double value) { return static_cast<float>(value); });
    }
  }
  validate(room, path.string());
  return room;
}

}  // namespace earshot
