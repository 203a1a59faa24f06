// SPDX-License-Identifier: Apache-2.0
#include "sim/sofa/sofa_writer.h"

#include <mutex>

#include "sim/base/errors.h"
#include "sim/base/version.h"
#include "sim/sofa/netcdf_file.h"

namespace earshot {
namespace {

/// Today's date would change the bytes of the same responses.
constexpr const char* kDate = "1970-01-01 00:00:00";
const NetcdfFile::Attributes kCartesian{{"Type", "cartesian"}, {"Units", "metre"}};

using Frame = SofaRoomResponses::Frame;

std::vector<double> column(const std::vector<Frame>& frames, glm::dvec3 Frame::*part) {
  std::vector<double> values;
  for (const Frame& frame : frames)
    for (int axis = 0; axis < 3; ++axis) values.push_back((frame.*part)[axis]);
  return values;
}

void add_global(NetcdfFile& file, const SofaRoomResponses& responses) {
  const auto text = [](const std::string& value) { return value.empty() ? std::string("none") : value; };
  file.add_attribute("Conventions", "SOFA");
  file.add_attribute("Version", "2.1");
  file.add_attribute("SOFAConventions", "SingleRoomSRIR");
  file.add_attribute("SOFAConventionsVersion", "1.0");
  file.add_attribute("DataType", "FIR");
  file.add_attribute("RoomType", responses.shoebox ? "shoebox" : "reverberant");
  file.add_attribute("Title", text(responses.title));
  file.add_attribute("DateCreated", kDate);
  file.add_attribute("DateModified", kDate);
  file.add_attribute("APIName", "earshot");
  file.add_attribute("APIVersion", kVersion);
  file.add_attribute("AuthorContact", "none");
  file.add_attribute("Organization", "none");
  file.add_attribute("License", "No license provided, ask the author for permission");
  file.add_attribute("ApplicationName", "earshot");
  file.add_attribute("ApplicationVersion", kVersion);
  file.add_attribute("DatabaseName", "earshot dataset rir");
  file.add_attribute("RoomDescription", text(responses.room_description));
  file.add_attribute("ListenerDescription", text(responses.listener_description));
  file.add_attribute("Comment", text(responses.comment));
}

}  // namespace

bool can_write_sofa() { return true; }

std::string encode_sofa(const SofaRoomResponses& responses, const std::string& where) {
  const std::size_t measurements = responses.listeners.size(), receivers = static_cast<std::size_t>(responses.num_receivers),
                    samples = static_cast<std::size_t>(responses.num_samples);
  require(measurements > 0 && receivers > 0 && samples > 0, where, measurements, "must have at least one response");
  EARSHOT_EXPECT(responses.samples.size() == measurements * receivers * samples);
  EARSHOT_EXPECT(responses.harmonics || responses.receivers.size() == receivers);

  static std::mutex one_at_a_time;  // what HDF5 holds is the process's, without locks of its own
  const std::lock_guard lock(one_at_a_time);
  NetcdfFile file(where);
  add_global(file, responses);
  for (const auto& [name, size] :
       {std::pair<char, std::size_t>{'I', 1}, {'C', 3}, {'R', receivers}, {'E', 1}, {'N', samples}, {'M', measurements}})
    file.add_dimension(name, size);

  file.add_variable("ListenerPosition", "MC", column(responses.listeners, &Frame::position), kCartesian);
  file.add_variable("ListenerView", "MC", column(responses.listeners, &Frame::view), kCartesian);
  file.add_variable("ListenerUp", "MC", column(responses.listeners, &Frame::up));
  if (responses.harmonics) {
    const std::vector<double> origin(3 * receivers, 0.0);
    file.add_variable("ReceiverPosition", "RCI", origin, {{"Type", "spherical harmonics"}, {"Units", "degree, degree, metre"}});
  } else {
    file.add_variable("ReceiverPosition", "RCI", column(responses.receivers, &Frame::position), kCartesian);
    file.add_variable("ReceiverView", "RCI", column(responses.receivers, &Frame::view), kCartesian);
    file.add_variable("ReceiverUp", "RCI", column(responses.receivers, &Frame::up));
  }
  const std::vector<Frame> source(measurements, responses.source);
  file.add_variable("SourcePosition", "MC", column(source, &Frame::position), kCartesian);
  file.add_variable("SourceView", "MC", column(source, &Frame::view), kCartesian);
  file.add_variable("SourceUp", "MC", column(source, &Frame::up));
  file.add_variable("EmitterPosition", "ECI", std::vector<double>(3, 0.0), kCartesian);
  if (responses.shoebox) {
    const auto& [a, b] = *responses.shoebox;
    file.add_variable("RoomCornerA", "IC", std::vector<double>{a.x, a.y, a.z});
    file.add_variable("RoomCornerB", "IC", std::vector<double>{b.x, b.y, b.z});
    file.add_variable("RoomCorners", "II", std::vector<double>{0}, kCartesian);
  }
  file.add_variable("RoomTemperature", "I", std::vector<double>{responses.temperature_k}, {{"Units", "kelvin"}});
  file.add_variable("Data.SamplingRate", "I", std::vector<double>{static_cast<double>(responses.sample_rate_hz)}, {{"Units", "hertz"}});
  file.add_variable("Data.Delay", "IR", std::vector<double>(receivers, 0.0));
  file.add_variable("Data.IR", "MRN", std::vector<double>(responses.samples.begin(), responses.samples.end()), {}, true);
  return file.finish();
}

}  // namespace earshot
