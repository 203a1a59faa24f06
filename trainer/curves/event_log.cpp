// SPDX-License-Identifier: Apache-2.0
#include "trainer/curves/event_log.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/base/text/json_number.h"
#include "sim/base/text/schema_version.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;  // curves keep the order in which they were written

constexpr std::size_t kMaxLogBytes = std::size_t{1} << 30;

std::string line_of(const CurvePoint& point) {
  Json values = Json::object();
  for (const auto& [name, value] : point.values) values[name] = std::isfinite(value) ? Json(value) : Json(nullptr);
  const Json line{{"update", point.update}, {"env_steps", point.env_steps}, {"wall_s", point.wall_s}, {"values", std::move(values)}};
  return json_text_of_any_bytes(line) + "\n";
}

/// Throws nlohmann::json::exception when the line is not a point, InputError naming `where` when it is of a newer version.
CurvePoint point_of(std::string_view line, const std::string& where) {
  // To the parser a zero byte is the end of the text.
  const Json json = parse_ordered_json(line.substr(0, line.find('\0') == std::string_view::npos ? line.size() : 0));
  check_schema_version(json, "schema_version", where, "an event log", {1, 1});
  CurvePoint point;
  point.update = whole_number<std::uint64_t>(json, "update");
  point.env_steps = whole_number<std::uint64_t>(json, "env_steps");
  point.wall_s = finite_number<double>(json, "wall_s");
  for (const auto& [name, value] : json.at("values").items())
    point.values.emplace_back(name, value.is_null() ? std::numeric_limits<double>::quiet_NaN() : value.get<double>());
  return point;
}

struct ParsedLog {
  std::vector<CurvePoint> points;
  std::vector<std::string> lines;  ///< as they stand in the file, line end included
};

ParsedLog parse_log(const std::filesystem::path& file) {
  const std::string text = read_file(file, kMaxLogBytes);
  ParsedLog log;
  int number = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    ++number;
    const std::size_t end = text.find('\n', begin);
    if (end == std::string::npos) break;  // torn: the write of this line did not finish
    const std::string line = text.substr(begin, end + 1 - begin);
    begin = end + 1;
    try {
      log.points.push_back(point_of(line, file.string()));
    } catch (const Json::exception&) {
      if (begin == text.size() && number > 1) break;  // a machine that crashed may leave zeros where the last line was to be
      throw InputError(fmt::format("{}:{}", file.string(), number), "is not a valid line of an event log",
                       "move the file to another folder, or correct the line");
    }
    log.lines.push_back(line);
  }
  return log;
}

}  // namespace

bool is_of_held_out(const CurvePoint& point) { return !point.values.empty() && point.values.front().first.starts_with("held_out/"); }

EventLog::EventLog(const std::filesystem::path& folder, std::uint64_t resumed_update, std::uint64_t evaluated_update)
    : path_(folder / "events.jsonl") {
  std::string kept;
  std::uint64_t kept_steps = 0;
  if (std::filesystem::exists(path_) && resumed_update > 0) {
    const ParsedLog log = parse_log(path_);
    for (std::size_t i = 0; i < log.points.size(); ++i) {
      const std::uint64_t last = is_of_held_out(log.points[i]) ? std::min(resumed_update, evaluated_update) : resumed_update;
      if (log.points[i].update > last) continue;
      kept += log.lines[i];
      kept_steps = std::max(kept_steps, log.points[i].env_steps);
    }
  }
  write_file_atomically(path_, kept);
  descriptor_ = ::open(path_.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
  if (descriptor_ < 0) throw RunError(path_.string(), "cannot be opened: " + last_error());
  tensorboard_.emplace(folder, static_cast<std::int64_t>(kept_steps + (kept.empty() ? 0 : 1)));
}

EventLog::~EventLog() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void EventLog::write(const CurvePoint& point) {
  const std::string line = line_of(point);
  struct stat status {};
  if (::fstat(descriptor_, &status) != 0) throw RunError(path_.string(), "cannot be read: " + last_error());
  ssize_t written = -1;
  do {
    written = ::write(descriptor_, line.data(), line.size());
  } while (written < 0 && errno == EINTR);
  if (written != static_cast<ssize_t>(line.size())) {
    const std::string reason = written < 0 ? last_error() : "no space left for a complete line";
    if (written > 0 && ::ftruncate(descriptor_, status.st_size) != 0)
      throw RunError(path_.string(),
                     fmt::format("cannot be written ({}), and the incomplete line cannot be removed ({})", reason, last_error()));
    throw RunError(path_.string(), "cannot be written: " + reason);
  }
  tensorboard_->write(static_cast<std::int64_t>(point.env_steps), point.values);
}

std::vector<CurvePoint> read_event_log(const std::filesystem::path& file) { return parse_log(file).points; }

}  // namespace earshot
