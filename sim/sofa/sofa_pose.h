// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "sim/sofa/sofa_variables.h"

namespace earshot {

/// Lengths below it are none, in metres.
inline constexpr double kSofaNoLength = 1e-6;

/// Triplets of a pose: one for all measurements, or one for each.
class SofaPose {
 public:
  /// usual: where the file has no such variable.  usual_type: where the variable has no Type.  Throws InputError for other sizes, types and
  /// units than those of AES69.
  SofaPose(const SofaFile& file, const char* name, glm::dvec3 usual, std::size_t measurements, const std::string& usual_type = "cartesian");
  /// In metres, or of any length for a view.
  [[nodiscard]] glm::dvec3 operator[](std::size_t measurement) const {
    return triplets_.size() == 1 ? triplets_[0] : triplets_[measurement];
  }
  [[nodiscard]] bool changes() const;
  [[nodiscard]] const std::string& type() const { return type_; }

 private:
  std::vector<glm::dvec3> triplets_;
  std::string type_ = "cartesian";
};

/// Receivers [R][3] for all measurements, or [R][3][M], in axes of the listener.
class SofaReceivers {
 public:
  /// Throws InputError for other sizes, types and units.
  SofaReceivers(const SofaFile& file, std::size_t measurements);
  [[nodiscard]] std::size_t count() const { return variable_.size[0]; }
  [[nodiscard]] bool changes() const { return depth_ > 1; }
  [[nodiscard]] glm::dvec3 at(std::size_t receiver, std::size_t measurement) const;

 private:
  SofaVariable variable_;
  std::size_t depth_ = 1;
  bool is_spherical_ = false;
};

/// Throws InputError for a view of no length.
void require_view(const SofaFile& file, const SofaPose& pose, std::size_t measurements, const char* name);

}  // namespace earshot
