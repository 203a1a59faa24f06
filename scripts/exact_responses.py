# SPDX-License-Identifier: Apache-2.0
"""Scenes of scripts/stated_errors.py and their exact responses, by code that shares nothing with the engine.

`images`: energies of all image sources of a box of mirrors (Allen and Berkley 1979).  `lambert`: rays between rectangles
that scatter all that they reflect; every vertex is connected with the source, through sheets that let sound through too.
"""

from __future__ import annotations

import math
import statistics

import numpy as np

SPEED = 343.2  # m/s, of the default air
BIN_S = 1e-3
METRICS = ["t20_s", "edt_s", "g_db", "c80_db", "drr_band_db"]
Point = tuple[float, float, float]


class Rectangle:
    """A sheet at `place` along `axis`, between `low` and `high` along the two other axes in their order."""

    def __init__(self, axis: int, place: float, low: tuple[float, float], high: tuple[float, float], kind: str):
        self.axis, self.place, self.low, self.high, self.kind = axis, place, low, high, kind
        self.others = [a for a in range(3) if a != axis]

    def corners(self) -> list[Point]:
        points = []
        for u, v in [(0, 0), (1, 0), (1, 1), (0, 1)]:
            point = [0.0, 0.0, 0.0]
            point[self.axis] = self.place
            point[self.others[0]] = (self.low, self.high)[u][0]
            point[self.others[1]] = (self.low, self.high)[v][1]
            points.append((point[0], point[1], point[2]))
        return points

    def holds(self, at_u: np.ndarray, at_v: np.ndarray) -> np.ndarray:
        """Whether places in its plane, along the two other axes, are on it."""
        return (at_u >= self.low[0]) & (at_u <= self.high[0]) & (at_v >= self.low[1]) & (at_v <= self.high[1])


def box(low: Point, high: Point, kinds: list[str]) -> list[Rectangle]:
    """Six walls; kinds: of x = low, x = high, and so on.  An empty kind leaves a wall out."""
    sides = []
    for axis in range(3):
        others = [a for a in range(3) if a != axis]
        for side, place in enumerate((low[axis], high[axis])):
            if kinds[2 * axis + side]:
                ends = [(p[others[0]], p[others[1]]) for p in (low, high)]
                sides.append(Rectangle(axis, place, ends[0], ends[1], kinds[2 * axis + side]))
    return sides


def with_door(
    axis: int, place: float, low: tuple[float, float], high: tuple[float, float], door: tuple[float, float, float], kind: str
) -> list[Rectangle]:
    """A wall across x or z with a hole from the floor: (from, to, height).  `low`, `high`: in the order of the other axes."""
    up = 0 if axis == 0 else 1  # of y among the other axes
    parts = []

    def part(begin: float, end: float, bottom: float, top: float) -> None:
        if end - begin > 1e-6 and top - bottom > 1e-6:
            a, b = ((bottom, begin), (top, end)) if up == 0 else ((begin, bottom), (end, top))
            parts.append(Rectangle(axis, place, a, b, kind))

    bottom, top, left, right = low[up], high[up], low[1 - up], high[1 - up]
    part(left, door[0], bottom, top)
    part(door[0], door[1], bottom + door[2], top)
    part(door[1], right, bottom, top)
    return parts


class Place:
    """A scene with a source and a listener.  materials: absorption, scattering, transmission by kind."""

    def __init__(
        self,
        truth: str,
        materials: dict[str, tuple[float, float, float]],
        source: Point,
        listener: Point,
        sheets: list[Rectangle] | None = None,
        spec: str = "",
        settings: tuple[str, ...] = (),
        length_s: float = 3.0,
    ):
        self.truth, self.materials, self.source, self.listener = truth, materials, source, listener
        self.sheets, self.spec, self.settings, self.length_s = sheets or [], spec, settings, length_s


def shoebox(
    truth: str, size: Point, absorption: list[float], scattering: float, source: Point, listener: Point, length_s: float = 3.0
) -> Place:
    kinds = [f"m{i}" for i in range(6)]
    return Place(
        truth,
        {k: (a, scattering, 0.0) for k, a in zip(kinds, absorption, strict=False)},
        source,
        listener,
        box((0, 0, 0), size, kinds),
        length_s=length_s,
    )


def two_rooms(tau: float) -> Place:
    kinds = ["wall", "", "wall", "wall", "wall", "wall"], ["", "wall", "wall", "wall", "wall", "wall"]
    sheets = box((0, 0, 0), (5, 3, 4), kinds[0]) + box((5, 0, 0), (9, 3, 4), kinds[1]) + [Rectangle(0, 5, (0, 0), (3, 4), "partition")]
    return Place("lambert", {"wall": (0.2, 1, 0), "partition": (0.2, 1, tau)}, (1.5, 1.5, 1.2), (7.3, 1.4, 2.6), sheets)


def doors(listener: Point, dead: float, live: float, door: tuple[float, float, float]) -> Place:
    sheets = box((0, 0, 0), (5, 3, 4), ["dead", "", "dead", "dead", "dead", "dead"]) + box(
        (5, 0, 0), (11, 3, 4), ["", "live", "live", "live", "live", "live"]
    )
    sheets += with_door(0, 5, (0, 0), (3, 4), door, "dead")
    return Place("lambert", {"dead": (dead, 1, 0), "live": (live, 1, 0)}, (2, 1.5, 1.2), listener, sheets)


def scenes() -> dict[str, Place]:
    bend = box((0, 0, 0), (10, 3, 2), ["wall", "wall", "wall", "wall", "wall", ""])
    bend += with_door(2, 2, (0, 0), (10, 3), (8, 10, 3), "wall") + box((8, 0, 2), (10, 3, 12), ["wall", "wall", "wall", "wall", "", "wall"])
    return {
        "box, Lambert": shoebox("lambert", (7, 3, 5), [0.2] * 6, 1, (1.7, 1.4, 1.2), (5.2, 1.6, 3.3)),
        "box of mirrors": shoebox("images", (7, 3, 5), [0.3, 0.25, 0.3, 0.35, 0.3, 0.25], 0, (1.7, 1.4, 1.2), (5.2, 1.6, 3.3), 1.6),
        "flutter, mirrors": shoebox("images", (5, 3, 4), [0.05, 0.05, 0.7, 0.7, 0.7, 0.7], 0, (1.5, 1.2, 1.4), (3.5, 1.6, 2.5), 2.0),
        "flutter, scattering 0.1": shoebox("high", (5, 3, 4), [0.05, 0.05, 0.7, 0.7, 0.7, 0.7], 0.1, (1.5, 1.2, 1.4), (3.5, 1.6, 2.5), 2.0),
        "corridor 60 m, Lambert": shoebox("lambert", (60, 2.5, 2), [0.1] * 6, 1, (5, 1.5, 1), (40, 1.5, 1.2)),
        "corridor 60 m, scattering 0.3": shoebox("high", (60, 2.5, 2), [0.1] * 6, 0.3, (5, 1.5, 1), (40, 1.5, 1.2)),
        "wall, tau 0.05": two_rooms(0.05),
        "wall, tau 0.0005": two_rooms(0.0005),
        "hall 100 m at 75 m": shoebox("lambert", (100, 12, 30), [0.25] * 6, 1, (10, 2, 12), (85, 2, 18), 5.0),
        "hall 100 m at 75 m, scattering 0.3": shoebox("high", (100, 12, 30), [0.25] * 6, 0.3, (10, 2, 12), (85, 2, 18), 5.0),
        "door, 0.4 m on the dead side": doors((4.6, 1.5, 2.0), 0.4, 0.06, (1.5, 2.5, 2.1)),
        "door, 0.4 m on the live side": doors((5.4, 1.5, 2.0), 0.4, 0.06, (1.5, 2.5, 2.1)),
        "coupled rooms, small hole": doors((8.5, 1.5, 1.2), 0.2, 0.06, (2.5, 2.8, 0.5)),
        "open air": Place("high", {}, (0, 1.5, 0), (6, 1.5, 4), spec="ground_and_wall"),
        "tube": shoebox("lambert", (20, 1, 1), [0.1] * 6, 1, (1.5, 0.5, 0.5), (16, 0.6, 0.45)),
        "tiny box": shoebox("lambert", (1.2, 0.8, 1.0), [0.15] * 6, 1, (0.3, 0.3, 0.3), (0.8, 0.5, 0.7), 0.6),
        "flat hall": shoebox("lambert", (30, 2.6, 30), [0.15] * 6, 1, (5, 1.4, 6), (22, 1.5, 21), 4.0),
        "dead room": shoebox("lambert", (6, 3, 5), [0.75] * 6, 1, (1.4, 1.5, 1.2), (4.4, 1.6, 3.6), 1.0),
        "live room": shoebox("lambert", (6, 3, 5), [0.05] * 6, 1, (1.4, 1.5, 1.2), (4.4, 1.6, 3.6), 4.0),
        "corridor with a corner": Place("lambert", {"wall": (0.12, 1, 0)}, (1.5, 1.5, 1), (9, 1.4, 10), bend),
        "house, next room": Place("high", {}, (2, 1.5, 2), (10, 1.5, 5), spec="house:7"),
    }


def room_values(energy: np.ndarray, direct: float) -> dict[str, float | None]:
    """As measure_band (sim/acoustics/core/energy_decay.h).  energy: from time zero on, without the direct sound."""
    left = np.cumsum(energy[::-1])[::-1]
    total = left[0] + direct
    if not total > 0:
        return {name: None for name in METRICS}

    def slope(levels: np.ndarray, begin_db: float, end_db: float) -> float | None:
        inside = np.flatnonzero((levels <= begin_db) & (levels >= end_db))
        if len(inside) < 3:
            return None
        per_s = np.polyfit(inside * BIN_S, levels[inside], 1)[0]
        return float(-60 / per_s) if per_s < 0 else None

    with np.errstate(divide="ignore"):
        levels = 10 * np.log10(left / total)
        whole = levels.copy()
        whole[0] = 0.0
    begin = min(-5.0, float(levels[0]))
    early = direct + energy[: round(0.08 / BIN_S)].sum()
    late = total - early
    return {
        "t20_s": slope(levels, begin, begin - 20),
        "edt_s": slope(whole, 0.0, -10.0),
        "g_db": 10 * math.log10(total * (4 * math.pi * 10) ** 2),
        "c80_db": 10 * math.log10(early / late) if late > 0 else None,
        "drr_band_db": 10 * math.log10(direct / left[0]) if direct > 0 and left[0] > 0 else None,
    }


def image_response(place: Place) -> tuple[np.ndarray, float]:
    """Energies of all image sources of a box of mirrors."""
    size = [max(s.place for s in place.sheets if s.axis == axis) for axis in range(3)]
    keep = [[1 - place.materials[s.kind][0] for s in place.sheets if s.axis == axis] for axis in range(3)]
    zero_s = math.dist(place.source, place.listener) / SPEED
    reach = SPEED * (place.length_s + zero_s)
    axes = []
    for axis in range(3):
        count = int(reach / (2 * size[axis])) + 1
        n = np.arange(-count, count + 1)
        places = np.concatenate([2 * n * size[axis] + place.source[axis], 2 * n * size[axis] - place.source[axis]])
        low = np.concatenate([np.abs(n), np.abs(n - 1)])  # reflections at the wall at 0
        high = np.concatenate([np.abs(n), np.abs(n)])
        axes.append(((places - place.listener[axis]) ** 2, keep[axis][0] ** low.astype(float) * keep[axis][1] ** high.astype(float)))
    energy = np.zeros(round(place.length_s / BIN_S))
    plane_m2 = axes[1][0][:, None] + axes[2][0][None, :]
    plane_gain = axes[1][1][:, None] * axes[2][1][None, :]
    for x_m2, gain in zip(*axes[0], strict=False):
        near = (plane_m2 < reach * reach - x_m2) & (plane_gain * gain > 1e-12)
        distance2 = plane_m2[near] + x_m2
        bins = ((np.sqrt(distance2) / SPEED - zero_s) / BIN_S + 1e-9).astype(int)
        inside = (bins >= 0) & (bins < len(energy))
        energy += np.bincount(bins[inside], (plane_gain[near] * gain / (16 * math.pi**2 * distance2))[inside], len(energy))
    direct = 1 / (16 * math.pi**2 * math.dist(place.source, place.listener) ** 2)
    energy[0] -= direct
    return np.maximum(energy, 0), direct


class LambertTracer:
    """Rays from the listener between sheets that scatter all; every vertex is connected with the source, through sheets too."""

    RAYS = 2000  # four times as many where nothing goes through walls

    def __init__(self, place: Place):
        self.place = place
        values = [place.materials[s.kind] for s in place.sheets]
        self.keep = np.array([1 - v[0] for v in values])
        self.tau = np.array([v[2] for v in values])

    def meet(self, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nearest, which = np.full(len(origin), np.inf), np.full(len(origin), -1)
        for number, sheet in enumerate(self.place.sheets):
            a, (u, v) = sheet.axis, sheet.others
            with np.errstate(divide="ignore", invalid="ignore"):
                t = (sheet.place - origin[:, a]) / direction[:, a]
                at_u, at_v = origin[:, u] + t * direction[:, u], origin[:, v] + t * direction[:, v]
            hit = (t > 1e-7) & (t < nearest) & sheet.holds(at_u, at_v)
            nearest, which = np.where(hit, t, nearest), np.where(hit, number, which)
        return nearest, which

    def passed(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Fraction that sheets between two points let through."""
        whole, fraction = end - start, np.ones(len(start))
        for number, sheet in enumerate(self.place.sheets):
            a, (u, v) = sheet.axis, sheet.others
            with np.errstate(divide="ignore", invalid="ignore"):
                t = (sheet.place - start[:, a]) / whole[:, a]
                at_u, at_v = start[:, u] + t * whole[:, u], start[:, v] + t * whole[:, v]
            hit = (t > 1e-6) & (t < 1 - 1e-6) & sheet.holds(at_u, at_v)
            fraction = np.where(hit, fraction * self.tau[number], fraction)
        return fraction

    def shortest_m(self, step_m: float = 0.02) -> float:
        """Length of the shortest way with one reflection, on a grid, where nothing comes straight.  Raises ValueError without one."""
        source, listener, shortest = np.array(self.place.source), np.array(self.place.listener), math.inf
        for sheet in self.place.sheets:
            ends = zip(sheet.low, sheet.high, strict=True)
            steps = [np.linspace(low, high, math.ceil((high - low) / step_m) + 2)[1:-1] for low, high in ends]
            u, v = (grid.ravel() for grid in np.meshgrid(*steps))
            points = np.full((len(u), 3), float(sheet.place))
            points[:, sheet.others[0]], points[:, sheet.others[1]] = u, v
            length_m = np.linalg.norm(points - source, axis=1) + np.linalg.norm(points - listener, axis=1)
            sides = np.sign([source[sheet.axis] - sheet.place, listener[sheet.axis] - sheet.place])
            if sides[0] != sides[1]:
                continue
            points[:, sheet.axis] += 1e-5 * sides[0]
            points, length_m = points[length_m < shortest], length_m[length_m < shortest]
            both = self.passed(points, np.tile(source, (len(points), 1))) * self.passed(points, np.tile(listener, (len(points), 1)))
            if (both > 0).any():
                shortest = float(length_m[both > 0].min())
        if not math.isfinite(shortest):
            raise ValueError("no way with one reflection from the source to the listener")
        return shortest

    def draw(self, seed: int) -> tuple[np.ndarray, float]:
        """One estimate of the response."""
        place, random = self.place, np.random.default_rng(seed)
        source, listener = np.array(place.source), np.array(place.listener)
        straight_m = math.dist(place.source, place.listener)
        direct = float(self.passed(listener[None], source[None])[0]) / (4 * math.pi * straight_m) ** 2
        zero_m = straight_m if direct > 0 else self.shortest_m()  # time zero is the first sound, one for all draws
        energy = np.zeros(round(place.length_s / BIN_S))
        reach = zero_m + len(energy) * BIN_S * SPEED
        count = self.RAYS * (1 if self.tau.any() else 4)
        cosine, angle = random.uniform(-1, 1, count), random.uniform(0, 2 * math.pi, count)
        sine = np.sqrt(1 - cosine**2)
        direction = np.stack([sine * np.cos(angle), cosine, sine * np.sin(angle)], 1)
        origin, path, weight, crossed = np.tile(listener, (count, 1)), np.zeros(count), np.full(count, 1 / count), np.zeros(count, bool)
        while len(origin):
            distance, which = self.meet(origin, direction)
            path = path + distance
            alive = (which >= 0) & (path < reach)
            origin, direction, path, weight, crossed, which, distance = (
                x[alive] for x in (origin, direction, path, weight, crossed, which, distance)
            )
            point = origin + distance[:, None] * direction
            axis = np.array([s.axis for s in place.sheets])[which]
            rows = np.arange(len(which))
            normal = np.zeros_like(point)
            normal[rows, axis] = -np.sign(direction[rows, axis])
            point[rows, axis] = np.array([s.place for s in place.sheets])[which]
            keep, tau = self.keep[which], self.tau[which]
            to_source = source - point
            far2 = (to_source**2).sum(1)
            height = (to_source * normal).sum(1) / np.sqrt(far2)
            seen = np.where(height > 0, self.passed(point + 1e-5 * normal, np.tile(source, (len(point), 1))), 0.0)
            brought = weight * keep * np.maximum(height, 0) * seen / (4 * math.pi**2 * far2)
            arrived = np.maximum(path + np.sqrt(far2) - zero_m, 0) / SPEED / BIN_S
            inside = (arrived < len(energy)) & (brought > 0)
            energy += np.bincount(arrived[inside].astype(int), brought[inside], len(energy))
            # What goes through: before the first crossing always followed, by one ray in ten, after it by chance.
            chance = np.where(tau > 0, np.where(crossed, tau / (tau + keep), 0.1), 0.0)
            through = random.uniform(size=len(point)) < chance
            stays = ~through | ~crossed
            stay_weight = weight * keep / np.where(crossed, 1 - chance, 1.0)
            pass_weight = weight * tau / np.maximum(chance, 1e-30)
            u, v = random.uniform(size=len(point)), random.uniform(0, 2 * math.pi, len(point))
            leaving = np.stack([np.sqrt(u) * np.cos(v), np.sqrt(u) * np.sin(v)], 1)
            up = normal * np.sqrt(1 - u)[:, None]
            others = np.stack([(axis + 1) % 3, (axis + 2) % 3], 1)
            up[rows, others[:, 0]], up[rows, others[:, 1]] = leaving[:, 0], leaving[:, 1]
            origin = np.concatenate([point[stays], point[through]])
            path, weight = np.concatenate([path[stays], path[through]]), np.concatenate([stay_weight[stays], pass_weight[through]])
            crossed = np.concatenate([crossed[stays], np.ones(int(through.sum()), bool)])
            direction = np.concatenate([up[stays], direction[through]])
        # What comes straight through a sheet is no direct sound.
        if direct < 0.999 / (4 * math.pi * straight_m) ** 2:
            energy[0] += direct
            direct = 0.0
        return energy, direct


def draw_truth(name: str, seed: int) -> tuple[list[float], float]:
    place = scenes()[name]
    energy, direct = image_response(place) if place.truth == "images" else LambertTracer(place).draw(seed)
    return energy.tolist(), direct


def jackknife(draws: list[tuple[list[float], float]]) -> dict[str, tuple[float, float]]:
    """Values of the mean of the draws with their standard errors."""
    series = np.array([d[0] for d in draws])
    direct = draws[0][1]
    whole, parts = room_values(series.mean(0), direct), []
    for leave in range(len(draws) if len(draws) > 1 else 0):
        parts.append(room_values(np.delete(series, leave, 0).mean(0), direct))
    values = {}
    for name in METRICS:
        of_parts = [p[name] for p in parts]
        if whole[name] is None or any(p is None for p in of_parts):
            continue
        error = math.sqrt((len(parts) - 1) * statistics.pvariance(of_parts)) if parts else 0.0
        values[name] = (whole[name], error)
    return values
