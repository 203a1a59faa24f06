// SPDX-License-Identifier: Apache-2.0
#include "sim/sofa/sofa_pose.h"

#include <fmt/format.h>

#include <algorithm>
#include <glm/geometric.hpp>

#include "sim/audio/measured/listener_frame.h"

namespace earshot {
namespace {

/// Whether these are the units of AES69, with the plural and the spelling of either side of the ocean.
bool are_units(std::string units, bool is_spherical) {
  std::erase(units, ' ');
  std::vector<std::string> parts;
  for (std::size_t at = 0; at <= units.size();) {
    const std::size_t comma = std::min(units.find(',', at), units.size());
    std::string part = units.substr(at, comma - at);
    if (part.ends_with('s')) part.pop_back();
    parts.push_back(part == "meter" || part == "m" ? "metre" : part);
    at = comma + 1;
  }
  if (is_spherical) return parts == std::vector<std::string>{"degree", "degree", "metre"};
  return (parts.size() == 1 || parts.size() == 3) && std::ranges::all_of(parts, [](const std::string& part) { return part == "metre"; });
}

}  // namespace

SofaPose::SofaPose(const SofaFile& file, const char* name, glm::dvec3 usual, std::size_t measurements, const std::string& usual_type) {
  std::optional<SofaVariable> variable = file.find(name);
  if (!variable) {
    triplets_.push_back(usual);
    return;
  }
  const std::size_t count = variable->values.size() / 3;
  if (variable->size.empty() || variable->values.size() % 3 != 0 || variable->size.back() != 3 || (count != 1 && count != measurements))
    throw file.refuse(fmt::format("has {} of {} instead of 1 or M = {} triplets", name, variable->shape(), measurements));
  type_ = variable->type.empty() ? usual_type : variable->type;
  if (type_ != "cartesian" && type_ != "spherical")
    throw file.refuse(fmt::format("has {} of Type '{}', which is neither cartesian nor spherical", name, type_));
  if (!variable->units.empty() && !are_units(variable->units, type_ == "spherical"))
    throw file.refuse(
        fmt::format("has {} in '{}' instead of {}", name, variable->units, type_ == "spherical" ? "'degree, degree, metre'" : "'metre'"));
  for (std::size_t i = 0; i < count; ++i) {
    const double* v = &variable->values[3 * i];
    triplets_.push_back(sofa_position({v[0], v[1], v[2]}, type_ == "spherical"));
  }
}

bool SofaPose::changes() const {
  return std::ranges::any_of(triplets_, [&](glm::dvec3 t) { return glm::length(t - triplets_[0]) > kSofaNoLength; });
}

SofaReceivers::SofaReceivers(const SofaFile& file, std::size_t measurements) : variable_(file.get("ReceiverPosition")) {
  const std::vector<std::size_t>& size = variable_.size;
  const bool has_depth = size.size() == 3;
  if ((size.size() != 2 && !has_depth) || size[1] != 3 || (has_depth && size[2] != 1 && size[2] != measurements))
    throw file.refuse(fmt::format("has ReceiverPosition of {} instead of R x 3 x 1 or R x 3 x M", variable_.shape()));
  depth_ = has_depth ? size[2] : 1;
  if (variable_.type != "cartesian" && variable_.type != "spherical")
    throw file.refuse(fmt::format("has ReceiverPosition of Type '{}', which is neither cartesian nor spherical", variable_.type));
  is_spherical_ = variable_.type == "spherical";
  if (!variable_.units.empty() && !are_units(variable_.units, is_spherical_))
    throw file.refuse(
        fmt::format("has ReceiverPosition in '{}' instead of {}", variable_.units, is_spherical_ ? "'degree, degree, metre'" : "'metre'"));
}

glm::dvec3 SofaReceivers::at(std::size_t receiver, std::size_t measurement) const {
  const std::size_t m = depth_ == 1 ? 0 : measurement;
  const auto value = [&](std::size_t axis) { return variable_.values[(3 * receiver + axis) * depth_ + m]; };
  return sofa_position({value(0), value(1), value(2)}, is_spherical_);
}

void require_view(const SofaFile& file, const SofaPose& pose, std::size_t measurements, const char* name) {
  for (std::size_t m = 0; m < measurements; ++m)
    if (!(glm::length(pose[m]) > kSofaNoLength)) throw file.refuse(fmt::format("has no direction in {} {}", name, m));
}

}  // namespace earshot
