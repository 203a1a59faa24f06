# SPDX-License-Identifier: Apache-2.0
"""The walkable floor with the names of habitat_sim's PathFinder, and the follower of shortest paths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import quaternion
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..._engine import Navigation

Point = Sequence[float] | NDArray[Any]

#: A point this far from the floor, in metres, is still on it.
ON_FLOOR_M = 0.05
#: An oracle does not make turns below this fraction of one action, so that it does not swing about its goal (docs/howto/habitat.md).
DEAD_BAND = 0.9


def triple(point: Point) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z


def rotation_of(heading_rad: float) -> Any:
    """The quaternion of a heading, counter-clockwise from -z."""
    return quaternion.quaternion(math.cos(heading_rad / 2), 0, math.sin(heading_rad / 2), 0)


def heading_of(rotation: Any) -> float:
    """Of a quaternion, or of its numbers [x, y, z, w]: where it turns -z, seen from above."""
    if not isinstance(rotation, quaternion.quaternion):
        x, y, z, w = (float(value) for value in rotation)
        rotation = quaternion.quaternion(w, x, y, z)
    ahead = quaternion.rotate_vectors(rotation, np.array([0.0, 0.0, -1.0]))
    return math.atan2(-ahead[0], -ahead[2])


class Draws:
    """Numbers of random points, which go on from floor to floor."""

    def __init__(self, seed: int) -> None:
        self.seed(seed)

    def seed(self, seed: int) -> None:
        self._seed = int(seed) % 2**63
        self._taken = 0

    def take(self) -> tuple[int, int]:
        """Seed and number of the next one."""
        self._taken += 1
        return self._seed, self._taken - 1


class Floor:
    """Points are foot points; those that take a point take the nearest one on the floor."""

    is_loaded = True

    def __init__(self, navigation: Navigation, draws: Draws) -> None:
        self._navigation = navigation
        self._draws = draws

    def seed(self, seed: int) -> None:
        self._draws.seed(seed)

    def snap_point(self, point: Point) -> NDArray[np.float64]:
        """NaN where the floor is more than 1 m away."""
        found = self._navigation.snap(triple(point), 1.0)
        return np.array(found if found else (math.nan,) * 3)

    def is_navigable(self, point: Point, max_y_delta: float = 0.5) -> bool:
        found = self._navigation.snap(triple(point), ON_FLOOR_M)
        if found is None or abs(found[1] - float(point[1])) > max_y_delta:
            return False
        return math.hypot(found[0] - float(point[0]), found[2] - float(point[2])) <= ON_FLOOR_M

    def get_random_navigable_point(self, max_tries: int = 10) -> NDArray[np.float64]:
        return np.array(self._navigation.random_point(*self._draws.take()))

    def geodesic_distance(self, start: Point, ends: Point | Sequence[Point]) -> float:
        """To the nearest of the ends; infinite where no path leads to any."""
        goals: Any = [ends] if np.ndim(ends[0]) == 0 else ends
        lengths = [self._navigation.distance_m(triple(start), triple(goal)) for goal in goals]
        return min((length for length in lengths if length is not None), default=math.inf)

    def shortest_path(self, start: Point, end: Point) -> list[NDArray[np.float64]]:
        """Its corners, start and end included; empty where there is none."""
        return list(self._navigation.path(triple(start), triple(end)))

    def try_step(self, start: Point, end: Point) -> NDArray[np.float64]:
        """Where a straight walk ends that slides along obstacles."""
        way = np.asarray(end, dtype=np.float64) - np.asarray(start, dtype=np.float64)
        return np.array(self._navigation.move(triple(start), triple(way))[0])


class GreedyFollower:
    """Follows the shortest path with the actions of the simulator, as habitat_sim.GreedyGeodesicFollower."""

    def __init__(self, sim: Any, goal_radius: float, keys: Sequence[Any]) -> None:
        self._sim = sim
        self._goal_radius = float(goal_radius)
        self._stop, self._forward, self._left, self._right = keys

    def next_action_along(self, goal: Point) -> Any:
        """stop within the radius of the goal, or where no path leads there."""
        state = self._sim.get_agent_state()
        floor: Floor = self._sim.pathfinder
        corners = floor.shortest_path(state.position, goal)
        if len(corners) < 2 or floor.geodesic_distance(state.position, goal) < self._goal_radius:
            return self._stop
        way = corners[1] - state.position
        angle = math.remainder(math.atan2(-way[0], -way[2]) - heading_of(state.rotation), 2 * math.pi)
        if abs(angle) <= DEAD_BAND * math.radians(self._sim.habitat_config.turn_angle):
            return self._forward
        return self._left if angle > 0 else self._right
