// SPDX-License-Identifier: Apache-2.0
#include "datasets/measured/measured_room.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <set>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/measured/room_responses.h"
#include "sim/base/coordinates.h"
#include "sim/base/errors.h"
#include "sim/base/process/companion_program.h"
#include "sim/base/process/isolated_call.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

namespace fs = std::filesystem;

constexpr std::array<const char*, 3> kPlaces{"places.yaml", "places.yml", "places.json"};

glm::quat orientation_of(double heading_deg, double pitch_deg) {
  const auto radians = [](double degrees) { return static_cast<float>(degrees * std::numbers::pi / 180.0); };
  return glm::angleAxis(radians(heading_deg), glm::vec3(0, 1, 0)) * glm::angleAxis(radians(pitch_deg), glm::vec3(1, 0, 0));
}

bool is_silent(const std::vector<float>& samples) {
  return std::ranges::all_of(samples, [](float sample) { return sample == 0.f; });
}

/// One entry of `responses`.
struct Place {
  std::string file;
  int channel = 0;
  std::vector<double> source, listener;
  double source_heading_deg = 0, source_pitch_deg = 0;
  std::optional<double> direct_delay_s;
};

struct Places {
  std::string scene, up = "y", source_pattern = "omni";
  std::vector<Place> responses;
};

void read(ConfigReader& reader, Place& place) {
  const Allowed coordinate = Allowed::between(-kMaxCoordinateM, kMaxCoordinateM).items(3);
  reader.read_required("file", place.file, Allowed::text("a sound file"), "Sound file with the response, from the measured folder on.");
  reader.read("channel", place.channel, Allowed::at_least(0), "Channel of the file that holds the response.");
  reader.read_required("source", place.source, coordinate, "Position of the source in metres.");
  reader.read_required("listener", place.listener, coordinate, "Position of the microphone in metres.");
  reader.read("source_heading_deg", place.source_heading_deg, Allowed::between(-360, 360),
              "Heading of the source, counter-clockwise from -z seen from above.");
  reader.read("source_pitch_deg", place.source_pitch_deg, Allowed::between(-90, 90), "Pitch of the source, positive is up.");
  reader.read("direct_delay_s", place.direct_delay_s, Allowed::at_least(0),
              "Time of the direct sound in the record. Without it that of the onset.");
}

void read(ConfigReader& reader, Places& places) {
  reader.read("scene", places.scene, Allowed::text("a SCENE"), "Scene of the room; a file from this one on. Empty: the command names it.");
  reader.read_choice("up", places.up, std::map<std::string, std::string>{{"y", "y"}, {"z", "z"}}, "Axis of the positions that points up.");
  reader.read("source_pattern", places.source_pattern, Allowed::text("a pattern or a file"),
              "Directivity of the sources, as --source-pattern; a file from this one on.");
  for (ConfigReader& child : reader.children("responses", "The measured responses, one map each.")) {
    Place& place = places.responses.emplace_back();
    read(child, place);
    child.finish();
  }
}

fs::path find_places(const fs::path& folder) {
  std::vector<fs::path> found;
  for (const char* name : kPlaces)
    if (fs::exists(folder / name)) found.push_back(folder / name);
  if (found.size() > 1)
    throw InputError(folder.string(), "has both " + found[0].filename().string() + " and " + found[1].filename().string(),
                     "keep one of the two, or name it with --places");
  if (found.empty())
    throw InputError(folder.string(), "has no places.yaml and no SOFA files",
                     "write the places of the responses to it (docs/howto/measured_rooms.md), or name a file with --places");
  return found[0];
}

/// What a file of the places names, unless it is a scene by another form than a file.
std::string from_file(const fs::path& file, const std::string& named) {
  if (named.empty() || fs::path(named).is_absolute()) return named;
  const fs::path beside = file.parent_path() / named.substr(0, named.find(','));
  return fs::exists(beside) ? (file.parent_path() / named).lexically_normal().string() : named;
}

glm::dvec3 world(const std::vector<double>& p, const std::string& up) {
  return up == "z" ? glm::dvec3(p[0], p[2], -p[1]) : glm::dvec3(p[0], p[1], p[2]);
}

MeasuredResponse load_response(const fs::path& folder, const Place& place, const std::string& up, float& sample_rate_hz) {
  const fs::path file = folder / place.file;
  const SoundChannels sound = load_sound_channels(file);
  if (place.channel >= sound.num_channels)
    throw InputError(file.string(), fmt::format("has {} channels, the places name channel {}", sound.num_channels, place.channel),
                     "count channels from 0");
  if (sample_rate_hz > 0 && sound.sample_rate_hz != sample_rate_hz)
    throw InputError(file.string(),
                     fmt::format("has a rate of {:.0f} Hz, files before it have {:.0f} Hz", sound.sample_rate_hz, sample_rate_hz),
                     "resample one of them");
  sample_rate_hz = sound.sample_rate_hz;
  const std::span<const float> channel = sound.channel(place.channel);
  MeasuredResponse response{.name = sound.num_channels > 1 ? fmt::format("{}:{}", place.file, place.channel) : place.file,
                            .source_m = world(place.source, up),
                            .listener_m = world(place.listener, up),
                            .source_orientation = orientation_of(place.source_heading_deg, place.source_pitch_deg),
                            .direct_delay_s = place.direct_delay_s,
                            .samples = {channel.begin(), channel.end()}};
  if (is_silent(response.samples))
    throw InputError(file.string(), fmt::format("is silent in channel {}", place.channel), "measure it again, or leave it out");
  const double length_s = static_cast<double>(response.samples.size()) / static_cast<double>(sample_rate_hz);
  if (response.direct_delay_s && !(*response.direct_delay_s < length_s))
    throw InputError(file.string(),
                     fmt::format("lasts {:.4g} s, the places put the direct sound at {:.4g} s", length_s, *response.direct_delay_s),
                     "correct direct_delay_s, or leave it out");
  return response;
}

MeasuredRoom load_sound_files(const fs::path& folder, const fs::path& file) {
  ConfigReader reader = ConfigReader::from_file(file);
  Places places;
  read(reader, places);
  reader.finish();
  if (places.responses.empty()) throw InputError(file.string(), "names no responses", "list them under responses");
  MeasuredRoom room{.scene = from_file(file, places.scene), .source_pattern = nullptr, .responses = {}};
  if (places.source_pattern != "omni") room.source_pattern = Directivity::named(from_file(file, places.source_pattern));
  std::set<std::pair<std::string, int>> seen;
  for (const Place& place : places.responses) {
    if (!seen.emplace(place.file, place.channel).second)
      throw InputError(file.string(), fmt::format("names channel {} of {} twice", place.channel, place.file), "keep one of the two");
    room.responses.push_back(load_response(folder, place, places.up, room.sample_rate_hz));
  }
  return room;
}

RoomResponses read_sofa(const fs::path& path) {
  const std::string where = path.string();
  IsolationLimits limits = limits_for_file(path);
  limits.worker = "HDF5";
  fs::path program;
  try {
    program = companion_program("earshot_hdf5_reader", "EARSHOT_HDF5_READER");
  } catch (const RunError&) {
    throw InputError(where, "cannot be read: this installation has no earshot_hdf5_reader, which a build with HDF5 has",
                     "set EARSHOT_HDF5_READER to that program, or use sound files with a places.yaml");
  }
  return decode_room(call_isolated(program, {"room", where}, where, limits), where);
}

/// Turns -z to `front`, upright where it can be.
glm::quat orientation_of(glm::dvec3 front) {
  const double horizontal = std::hypot(front.x, front.z);
  constexpr double degrees = 180.0 / std::numbers::pi;
  return orientation_of(horizontal > 0 ? degrees * std::atan2(-front.x, -front.z) : 0.0, degrees * std::atan2(front.y, horizontal));
}

MeasuredRoom load_sofa_files(const std::vector<fs::path>& files) {
  MeasuredRoom room;
  for (const fs::path& file : files) {
    const RoomResponses of_file = read_sofa(file);
    if (room.sample_rate_hz > 0 && of_file.sample_rate_hz != room.sample_rate_hz)
      throw InputError(file.string(),
                       fmt::format("has a rate of {:.0f} Hz, files before it have {:.0f} Hz", of_file.sample_rate_hz, room.sample_rate_hz),
                       "resample one of them");
    room.sample_rate_hz = of_file.sample_rate_hz;
    for (std::size_t i = 0; i < of_file.responses.size(); ++i) {
      const RoomResponses::Response& response = of_file.responses[i];
      const auto first = of_file.samples.begin() + static_cast<std::ptrdiff_t>(i * of_file.num_samples);
      MeasuredResponse& measured = room.responses.emplace_back();
      measured.name = fmt::format("{}:{}", file.filename().string(), i);
      measured.source_m = response.source_m, measured.listener_m = response.listener_m;
      measured.source_orientation = orientation_of(response.source_front);
      measured.samples.assign(static_cast<std::size_t>(std::lround(response.delay_samples)), 0.f);
      measured.samples.insert(measured.samples.end(), first, first + static_cast<std::ptrdiff_t>(of_file.num_samples));
      if (is_silent(measured.samples))
        throw InputError(file.string(), fmt::format("is silent in response {}", i), "measure it again, or leave it out");
    }
  }
  return room;
}

std::vector<fs::path> sofa_files_in(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder))
    if (fold_case(entry.path().extension().string()) == ".sofa") files.push_back(entry.path());
  std::ranges::sort(files);
  return files;
}

}  // namespace

MeasuredRoom load_measured_room(const fs::path& measured, const fs::path& places) {
  std::error_code error;
  if (!fs::exists(measured, error)) throw InputError(measured.string(), "no such folder or file", "check the path");
  if (!fs::is_directory(measured, error)) {
    if (fold_case(measured.extension().string()) != ".sofa")
      throw InputError(measured.string(), "is neither a folder nor a SOFA file", "name the folder of the measured responses");
    if (!places.empty()) throw InputError("--places", "has no effect with a SOFA file, which holds its places", "leave it out");
    return load_sofa_files({measured});
  }
  if (places.empty()) {
    const std::vector<fs::path> files = sofa_files_in(measured);
    if (!files.empty() && has_places(measured))
      throw InputError(measured.string(), "has SOFA files and a file of places", "name one SOFA file, or the places with --places");
    if (!files.empty()) return load_sofa_files(files);
  }
  return load_sound_files(measured, places.empty() ? find_places(measured) : places);
}

bool has_places(const fs::path& measured) {
  return std::ranges::any_of(kPlaces, [&](const char* name) { return fs::exists(measured / name); });
}

std::vector<ConfigKey> places_keys() {
  ConfigReader reader = ConfigReader::describer();
  Places places;
  read(reader, places);
  return reader.described();
}

}  // namespace earshot
