# SPDX-License-Identifier: Apache-2.0
"""Plots by matplotlib (extra ``plot``), which is imported by the calls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from . import _arguments as check
from ._engine import InputError

if TYPE_CHECKING:
    from .acoustics import Scene, Source
    from .responses import Response

FLOOR_DB = -80.0
MOST_PLACES = 4000


def _axes(ax: Any) -> Any:
    if ax is not None:
        return ax
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install 'earshot-rl[plot]'") from error
    return plt.subplots()[1]


def plot_scene(scene: Scene, ax: Any, points: ArrayLike | None, path: ArrayLike | None) -> Any:
    places = None if points is None else check.positions(points, "Scene.plot", "points")[0]
    walk = None if path is None else check.positions(path, "Scene.plot", "path")[0]
    ax = _axes(ax)
    walls = scene.section()
    # One line with gaps instead of one per wall.
    lines = np.full((len(walls), 3, 2), np.nan)
    lines[:, :2] = walls[:, :, [0, 2]]
    ax.plot(*lines.reshape(-1, 2).T, color="0.3", linewidth=1)
    if walk is not None:
        ax.plot(walk[:, 0], walk[:, 2], color="C0", marker=".")
        ax.plot(walk[-1:, 0], walk[-1:, 2], color="C0", marker="o")
    if places is not None:
        ax.plot(places[:, 0], places[:, 2], "o", color="C3")
    ax.set_aspect("equal")
    ax.invert_yaxis()  # -z is up, as headings are counted
    ax.set(title=scene.name, xlabel="x (m)", ylabel="z (m)")
    return ax


def plot_response(response: Response, ax: Any) -> Any:
    ax = _axes(ax)
    arrivals, late = response.arrivals, response.late[..., 0].sum(axis=1)
    level = 10 * np.log10(np.maximum((arrivals.amplitude.astype(np.float64) ** 2).mean(axis=1), 1e-30))
    reference = level.max() if len(level) else 0.0
    shown = level > reference + FLOOR_DB
    if shown.any():
        ax.vlines(arrivals.delay_s[shown] * 1000, reference + FLOOR_DB, level[shown], color="C0", label="paths")
    left = np.cumsum(late[::-1].astype(np.float64))[::-1]
    if left.size and left[0] > 0:
        time_ms = np.arange(left.size) * response.bin_s * 1000
        curve = 10 * np.log10(np.maximum(left / left[0], 10 ** (FLOOR_DB / 10))) + reference
        ax.plot(time_ms, curve, color="C1", label="late energy that is left")
    ax.set(title=response.source.scene.name, xlabel="time (ms)", ylabel="level (dB)", ylim=(reference + FLOOR_DB, reference + 5))
    ax.legend()
    return ax


def plot_field(source: Source, quantity: str, step_m: float, height_m: float, ax: Any) -> Any:
    from ._results import Metrics

    where = "Source.plot"
    names = [name for name in Metrics.__dataclass_fields__ if name != "bands_hz"]
    check.one_of(quantity, where, "quantity", names)
    step = check.number(step_m, where, "step_m", 0, above=True)
    height = check.number(height_m, where, "height_m", 0, 10, above=True)
    scene = source.scene
    low, high = scene.bounds
    xs, zs = (np.arange(low[axis] + step / 2, high[axis], step) for axis in (0, 2))
    if not 0 < len(xs) * len(zs) <= MOST_PLACES:
        raise InputError(f"{where}: step_m is {step:g}, which gives {len(xs) * len(zs)} places; give one for 1 to {MOST_PLACES}")
    values = np.full((len(zs), len(xs)), np.nan)
    for row, z in enumerate(zs):
        for column, x in enumerate(xs):
            try:
                found = getattr(source.response([x, low[1] + height, z], channels="mono").metrics, quantity)
            except InputError:  # outside the rooms
                continue
            values[row, column] = found if np.ndim(found) == 0 else found[int(np.abs(scene.bands_hz - 1000).argmin())]
    ax = plot_scene(scene, ax, source.position, None)
    edges = (xs[0] - step / 2, xs[-1] + step / 2, zs[-1] + step / 2, zs[0] - step / 2)
    image = ax.imshow(values, extent=edges, zorder=0)
    ax.figure.colorbar(image, ax=ax, label=quantity)
    return ax
