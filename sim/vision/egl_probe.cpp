// SPDX-License-Identifier: Apache-2.0
// The part of sim/vision/egl_device.h that asks another process.
#include <fmt/format.h>

#include <charconv>
#include <chrono>
#include <nlohmann/json.hpp>

#include "sim/base/errors.h"
#include "sim/base/process/isolated_call.h"
#include "sim/base/text/json.h"
#include "sim/vision/egl_device.h"
#include "sim/vision/egl_opening.h"

namespace earshot {
namespace {

constexpr const char* kCount = "count";
/// A driver that compiles its first shaders on a loaded machine takes seconds.
constexpr IsolationLimits kDriver{
    .wall_time = std::chrono::milliseconds(30'000), .memory_bytes = IsolationLimits::kUnlimited, .worker = "its driver"};

std::string ask(const std::string& question) {
  const std::string where = question == kCount ? "EGL" : "EGL device " + question;
  return call_isolated(reader_program(), {"egl", question}, where, kDriver);
}

std::string encode(const EglDevice& device) {
  nlohmann::json fields{{"renderer", device.renderer}, {"problem", device.problem}, {"uuid", device.uuid}, {"software", device.software}};
  if (device.cuda) fields["cuda"] = *device.cuda;
  // A driver names itself in any bytes.
  return json_text_of_any_bytes(fields);
}

EglDevice decode(int index, const std::string& text) {
  const nlohmann::json fields = parse_json(text);
  EglDevice device{.index = index,
                   .renderer = fields.at("renderer"),
                   .problem = fields.at("problem"),
                   .uuid = fields.at("uuid"),
                   .software = fields.at("software")};
  if (fields.contains("cuda")) device.cuda = fields.at("cuda").get<int>();
  return device;
}

}  // namespace

EglDevice probe_egl_device(int index) {
  const std::string question = std::to_string(index);
  try {
    return decode(index, ask(question));
  } catch (const InputError& error) {
    EglDevice device{.index = index, .problem = error.what()};
    const std::string where = "EGL device " + question + ": ";
    if (device.problem.starts_with(where)) device.problem.erase(0, where.size());
    return device;
  } catch (const nlohmann::json::exception&) {
    throw RunError("earshot_reader", "belongs to another build; build earshot and earshot_reader together, or unset EARSHOT_READER");
  }
}

std::vector<EglDevice> list_egl_devices() {
  std::vector<EglDevice> listed;
  int count = 0;
  try {
    const std::string answer = ask(kCount);
    if (std::from_chars(answer.data(), answer.data() + answer.size(), count).ec != std::errc()) count = 0;
  } catch (const InputError& error) {
    return {{.index = EglDevice::kSurfaceless, .problem = error.what()}};
  }
  for (int index = 0; index < count; ++index) listed.push_back(probe_egl_device(index));
  if (!listed.empty()) return listed;
  EglDevice surfaceless = probe_egl_device(EglDevice::kSurfaceless);
  if (!surfaceless.renderer.empty()) listed.push_back(std::move(surfaceless));
  return listed;
}

std::string answer_egl_probe(std::string_view question) {
  if (question == kCount) return std::to_string(count_egl_devices());
  int index = 0;
  const auto parsed = std::from_chars(question.data(), question.data() + question.size(), index);
  if (parsed.ec != std::errc() || parsed.ptr != question.data() + question.size() || index < EglDevice::kSurfaceless)
    throw InputError(fmt::format("egl {}", question), "is not a question", "build earshot and earshot_reader together");
  return encode(open_egl_device(index));
}

}  // namespace earshot
