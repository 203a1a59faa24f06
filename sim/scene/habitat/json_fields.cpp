// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/habitat/json_fields.h"

#include <fmt/format.h>

#include <cmath>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json_size.h"
#include "sim/scene/readers/mesh_builder.h"

namespace earshot {
namespace {

constexpr std::size_t kLargestJson = std::size_t{64} << 20;
/// A scene of 10,000 objects has 200,000 values.
constexpr JsonLimits kSceneJsonLimits{.values = 4'000'000, .texts = 2'000'000, .lists = 1'000'000};
/// Quaternions are written with the digits of floats, or by hand with fewer.
constexpr double kQuaternionTolerance = 0.01;

/// nullopt for what is no list of `count` finite numbers.
std::optional<std::array<double, 4>> numbers_of(const nlohmann::json& json, std::size_t count) {
  if (!json.is_array() || json.size() != count) return std::nullopt;
  std::array<double, 4> numbers{};
  for (std::size_t i = 0; i < count; ++i) {
    if (!json[i].is_number()) return std::nullopt;
    numbers[i] = json[i].get<double>();
    if (!std::isfinite(numbers[i])) return std::nullopt;
  }
  return numbers;
}

}  // namespace

nlohmann::json parse_json_object(std::string_view text, const std::string& where) {
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  nlohmann::json json = parse_sized_json(text, where, kSceneJsonLimits);
  if (!json.is_object()) throw InputError(where, "is not a JSON object", "copy the file again");
  return json;
}

nlohmann::json read_json_object(const std::filesystem::path& path) {
  return parse_json_object(read_file(path, kLargestJson), path.string());
}

JsonFields::JsonFields(const nlohmann::json& json, std::filesystem::path file, std::string place)
    : json_(&json), file_(std::move(file)), place_(std::move(place)) {
  if (!json.is_object()) throw InputError(file_.string(), fmt::format("{} is not an object", place_), "write it as {\"key\": value}");
}

std::string JsonFields::place_of(std::string_view key) const {
  return one_line(place_.empty() ? std::string(key) : fmt::format("{}.{}", place_, key));
}

void JsonFields::fail(std::string_view key, const std::string& problem, const std::string& advice) const {
  throw InputError(file_.string(), fmt::format("{} {}", place_of(key), problem), advice);
}

std::optional<std::string> JsonFields::text(const char* key) const {
  if (!has(key)) return std::nullopt;
  const nlohmann::json& value = (*json_)[key];
  if (!value.is_string()) fail(key, "is not a text", "write it in quotes");
  return value.get<std::string>();
}

std::optional<double> JsonFields::number(const char* key, double lower, double upper) const {
  if (!has(key)) return std::nullopt;
  const nlohmann::json& value = (*json_)[key];
  const double number = value.is_number() ? value.get<double>() : std::nan("");
  if (!(number >= lower && number <= upper)) fail(key, "is out of range", fmt::format("write a number from {:g} to {:g}", lower, upper));
  return number;
}

std::optional<std::int64_t> JsonFields::whole(const char* key) const {
  if (!has(key)) return std::nullopt;
  const nlohmann::json& value = (*json_)[key];
  if (!value.is_number_integer()) fail(key, "is not a whole number", "write a whole number");
  return value.get<std::int64_t>();
}

std::optional<glm::dvec3> JsonFields::vector(const char* key, double largest) const {
  if (!has(key)) return std::nullopt;
  const auto numbers = numbers_of((*json_)[key], 3);
  if (!numbers) fail(key, "is not a list of three numbers", "write [x, y, z]");
  const glm::dvec3 vector((*numbers)[0], (*numbers)[1], (*numbers)[2]);
  for (int axis = 0; axis < 3; ++axis)
    if (std::fabs(vector[axis]) > largest) fail(key, "is out of range", fmt::format("write numbers up to {:g}", largest));
  return vector;
}

std::optional<glm::dquat> JsonFields::rotation(const char* key) const {
  if (!has(key)) return std::nullopt;
  const auto numbers = numbers_of((*json_)[key], 4);
  if (!numbers) fail(key, "is not a list of four numbers", "write [w, x, y, z]");
  const auto [w, x, y, z] = *numbers;
  const double length = std::sqrt(w * w + x * x + y * y + z * z);
  if (!(std::fabs(length - 1) <= kQuaternionTolerance))
    fail(key, fmt::format("has the length {:.4g}", length), "write a quaternion [w, x, y, z] of length 1");
  return glm::dquat(w / length, x / length, y / length, z / length);
}

const nlohmann::json* JsonFields::list(const char* key) const {
  if (!has(key)) return nullptr;
  if (!(*json_)[key].is_array()) fail(key, "is not a list", "write [...]");
  return &(*json_)[key];
}

const nlohmann::json* JsonFields::object(const char* key) const {
  if (!has(key)) return nullptr;
  if (!(*json_)[key].is_object()) fail(key, "is not an object", "write {...}");
  return &(*json_)[key];
}

void JsonFields::add_unknown(const std::set<std::string_view>& known, std::set<std::string>& unknown) const {
  for (const auto& [key, value] : json_->items())
    if (!known.contains(key)) unknown.insert(fmt::format("'{}' in {}", one_line(key), file_.filename().string()));
}

}  // namespace earshot
