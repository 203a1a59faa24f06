// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Positions, directions and boxes.

#include "earshot/errors.h"

namespace earshot::api {

/// A place in metres or a direction.  Positions are in the coordinates of the scene's file: y points up.
struct Vec3 {
  double x = 0, y = 0, z = 0;
  friend bool operator==(const Vec3&, const Vec3&) = default;
};

/// Axis-aligned box.
struct Bounds {
  Vec3 lower, upper;
};

}  // namespace earshot::api
