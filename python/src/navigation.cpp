// SPDX-License-Identifier: Apache-2.0
// The walkable floor of a scene.
#include "earshot/navigation.h"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <cstdint>
#include <optional>
#include <tuple>
#include <vector>

#include "python/src/interruptible.h"

namespace earshot::python {
namespace {

using Point = std::tuple<double, double, double>;

Vec3 vec3_of(const Point& point) { return {std::get<0>(point), std::get<1>(point), std::get<2>(point)}; }
Point point_of(const Vec3& place) { return {place.x, place.y, place.z}; }

std::optional<Point> snap(const Navigation& floor, const Point& point, double reach_m) {
  const auto found = floor.snap(vec3_of(point), reach_m);
  if (!found) return std::nullopt;
  return point_of(*found);
}

/// [corners, 3]
Array<double> path_of(const Navigation& floor, const Point& from, const Point& to) {
  std::vector<double> numbers;
  for (const Vec3& corner : floor.path(vec3_of(from), vec3_of(to))) numbers.insert(numbers.end(), {corner.x, corner.y, corner.z});
  const std::size_t rows = numbers.size() / 3;
  return array_of(std::move(numbers), {rows, 3});
}

std::tuple<Point, bool> move(const Navigation& floor, const Point& from, const Point& displacement) {
  const MoveResult moved = floor.move(vec3_of(from), vec3_of(displacement));
  return {point_of(moved.position), moved.collided};
}

}  // namespace

void bind_navigation(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<Navigation>(m, "Navigation")
      .def_prop_ro("area_m2", &Navigation::area_m2)
      .def_prop_ro("num_islands", &Navigation::num_islands)
      .def("snap", &snap, "point"_a, "reach_m"_a)
      .def(
          "random_point",
          [](const Navigation& floor, std::uint64_t seed, std::uint32_t index) { return point_of(floor.random_point(seed, index)); },
          "seed"_a, "index"_a)
      .def(
          "distance_m",
          [](const Navigation& floor, const Point& from, const Point& to) { return floor.distance_m(vec3_of(from), vec3_of(to)); },
          "from_point"_a, "to_point"_a)
      .def("path", &path_of, "from_point"_a, "to_point"_a)
      .def("move", &move, "from_point"_a, "displacement"_a);
}

}  // namespace earshot::python
