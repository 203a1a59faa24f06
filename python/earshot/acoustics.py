# SPDX-License-Identifier: Apache-2.0
"""Scenes, sources and responses: room impulse responses, their paths and room-acoustic parameters, as numpy arrays.

Positions are metres in the coordinates of the scene's file, y up; angles degrees, headings counter-clockwise from -z seen from above.
Pressure is in Green units: a unit source gives 1 / (4 pi r) at distance r.  Equal arguments and seeds give equal bits, for any number of
threads, and those of ``earshot rir`` where it is built with the same transforms (docs/howto/python.md).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _engine
from ._engine import InputError

Floats = NDArray[np.float64]
ARRIVAL_KINDS = ("direct", "reflection", "diffraction", "transmission")


@dataclass(frozen=True)
class EffectDecision:
    """One line of the effect plan: what is simulated in a scene, and the bound that the decision rests on."""

    effect: str
    decision: str
    on: bool
    change: float  #: off: by how much that changes a response at most; NaN: no such number
    unit: str
    kind: str  #: what it rests on: exact, bounded, approximated, user_set
    saved_ms: float
    why: str


@dataclass(frozen=True)
class Metrics:
    """Room-acoustic parameters after ISO 3382-1, one value per band; NaN: no such value (no decay to fit, no direct sound)."""

    bands_hz: Floats
    edt_s: Floats
    t20_s: Floats
    t30_s: Floats
    rt60_s: Floats
    c50_db: Floats
    c80_db: Floats
    d50: Floats
    ts_s: Floats
    g_db: Floats
    drr_band_db: Floats
    iacc: Floats  #: of binaural RIRs only, as the two that follow
    iacc_early: Floats
    iacc_late: Floats
    drr_db: float
    direct_delay_s: float
    direct_amplitude: float


@dataclass(frozen=True)
class Arrivals:
    """Deterministic paths from source to listener, sorted by distance: n arrivals, b bands."""

    kind: NDArray[np.uint8]  #: [n], index into ARRIVAL_KINDS
    order: NDArray[np.int32]  #: [n], number of reflections, edges or walls
    identity: NDArray[np.uint64]  #: [n], of the planes or edges: the same path at another pose has the same number
    delay_s: Floats  #: [n], after emission
    distance_m: NDArray[np.float32]  #: [n]
    direction: NDArray[np.float32]  #: [n, 3], unit, from the listener toward where the sound comes from
    departure: NDArray[np.float32]  #: [n, 3], unit, from the source toward where the sound goes
    amplitude: NDArray[np.float32]  #: [n, b], pressure in Green units
    phase_rad: NDArray[np.float32]  #: [n, b], beyond that of the delay

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def kind_names(self) -> list[str]:
        return [ARRIVAL_KINDS[kind] for kind in self.kind]


@dataclass(frozen=True)
class AccuracyChoice:
    """One way to compute the responses of a source, tried at a few listeners."""

    method: str  #: listener rays, source field or both ends
    settings: dict[str, str]  #: for ``Scene(settings=...)``
    predicted: dict[str, float]  #: errors at other listeners: t20_pct, drr_db, edc_db; NaN: no such value
    per_source_ms: float
    per_response_ms: float


@dataclass(frozen=True)
class AccuracyPlan:
    """The cheapest settings that keep an accuracy, and all that were tried."""

    choice: AccuracyChoice
    tried: list[AccuracyChoice]  #: in the order of trial
    reference_error: dict[str, float]  #: standard error of the paths that judged
    calibration_s: float


def _choice(values: Mapping[str, Any]) -> AccuracyChoice:
    settings = dict(text.split("=", 1) for text in values["settings"])
    return AccuracyChoice(**{**values, "settings": settings})


def _positions(value: ArrayLike, key: str) -> tuple[Floats, bool]:
    """As [n, 3], and whether it was a single one."""
    array = np.ascontiguousarray(value, dtype=np.float64)
    if array.shape == (3,):
        return array.reshape(1, 3), True
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{key}: has shape {array.shape}; give one position [3] or several [n, 3]")
    return array, False


def _angles(count: int, heading_deg: ArrayLike, pitch_deg: ArrayLike, roll_deg: ArrayLike) -> Floats:
    angles = np.empty((count, 3))
    for column, (name, value) in enumerate((("heading_deg", heading_deg), ("pitch_deg", pitch_deg), ("roll_deg", roll_deg))):
        array = np.asarray(value, dtype=np.float64)
        if array.shape not in ((), (count,)):
            raise InputError(f"{name}: has shape {array.shape} for {count} listeners; give one number or one per listener")
        angles[:, column] = array
    return angles


def _settings(settings: Mapping[str, Any] | Sequence[str]) -> list[str]:
    if not isinstance(settings, Mapping):
        return list(settings)
    texts = {True: "on", False: "off"}
    return [f"{key}={texts[value] if isinstance(value, bool) else value}" for key, value in settings.items()]


class Response:
    """What one listener receives from one source, before any head or microphone: independent of the listener's orientation."""

    def __init__(self, model: _engine.ResponseModel, channels: str) -> None:
        self._model = model
        self._channels = channels

    @cached_property
    def arrivals(self) -> Arrivals:
        return Arrivals(**self._model.arrivals())

    @cached_property
    def metrics(self) -> Metrics:
        """From the energy response: exact times, no noise of carriers."""
        return Metrics(**self._model.metrics())

    @property
    def late(self) -> NDArray[np.float32]:
        """Energy of the late field, [time bins, bands, harmonics]: a read-only view."""
        return self._model.late()

    @property
    def bin_s(self) -> float:
        """Seconds of a time bin of `late`, counted from emission."""
        return self._model.bin_s

    @property
    def speed_of_sound_m_per_s(self) -> float:
        return self._model.speed_of_sound_m_per_s

    @property
    def ray_efficiency(self) -> float:
        return self._model.ray_efficiency

    def render(
        self,
        heading_deg: float = 0,
        *,
        pitch_deg: float = 0,
        roll_deg: float = 0,
        channels: str | None = None,
        hrtf: str = "",
    ) -> NDArray[np.float32]:
        """The impulse response [channels, samples] for a listener of this orientation; channels: default those of the request."""
        return self._model.render(heading_deg, pitch_deg, roll_deg, channels or self._channels, str(hrtf))


class Source:
    """A source that stands still.  Its paths are found once; after 300 listeners in a call its late field is, where that is cheaper."""

    def __init__(self, model: _engine.SourceModel, scene: Scene) -> None:
        self._model = model
        self.scene = scene

    def render(
        self,
        listener: ArrayLike,
        heading_deg: ArrayLike = 0,
        *,
        pitch_deg: ArrayLike = 0,
        roll_deg: ArrayLike = 0,
        channels: str = "binaural",
        hrtf: str = "",
        threads: int = 0,
    ) -> NDArray[np.float32]:
        """Impulse responses: [channels, samples] of one listener [3], [n, channels, samples] of several [n, 3].

        channels: mono[:PATTERN], binaural, ambisonic:ORDER[:n3d|:sn3d][:world|:ego], or array:FILE.  hrtf: SOFA file; empty: a rigid
        sphere.  threads: over the listeners; 0: all cores.
        """
        positions, single = _positions(listener, "listener")
        angles = _angles(len(positions), heading_deg, pitch_deg, roll_deg)
        rirs = self._model.render(positions, angles, channels, str(hrtf), threads)
        self.scene._tell()
        return rirs[0] if single else rirs

    def response(self, listener: ArrayLike, *, channels: str = "binaural") -> Response:
        """The response at one place.  channels: what may be rendered from it."""
        positions, single = _positions(listener, "listener")
        if not single:
            raise InputError(f"listener: has shape {positions.shape}; give one position [3], or call responses")
        model = self._model.respond(positions, channels, 1)[0]
        self.scene._tell()
        return Response(model, channels)

    def responses(self, listeners: ArrayLike, *, channels: str = "binaural", threads: int = 0) -> list[Response]:
        positions, _ = _positions(listeners, "listeners")
        models = self._model.respond(positions, channels, threads)
        self.scene._tell()
        return [Response(model, channels) for model in models]

    def plan_accuracy(self, target: str, listeners: ArrayLike, *, responses: int | None = None) -> AccuracyPlan:
        """The cheapest settings within `target` for responses at places like `listeners`, [3] or [n, 3], as ``earshot rir --accuracy``.

        target: as "t20=5%,drr=1dB,edc=1dB".  responses: that the source is for; default: one per listener.  Rays, source_rays,
        early_order, field and the other keys of the plan replace those of the scene; the rest of its settings stays.  Takes seconds.
        Raises InputError where no candidate keeps the target.
        """
        positions, _ = _positions(listeners, "listeners")
        plan = self._model.plan_accuracy(target, positions, len(positions) if responses is None else responses)
        tried = [_choice(values) for values in plan["tried"]]
        return AccuracyPlan(tried[plan["chosen"]], tried, plan["reference_error"], plan["calibration_s"])


class Scene:
    """A scene with acoustic settings.

    spec: a mesh file, ``shoebox:XxYxZ[@M]``, ``house:SEED[,key=value]``, ``floor:SEED`` or a scene YAML.  preset: fast, balanced or high;
    settings: a dict (or "key=value" texts) over it, as ``earshot rir --set``.  unit_m: metres per unit of a mesh file; up: its axis that
    points up, y or z; None: what a scene YAML says, else 1 and y.

    A source or a listener outside a closed scene, which nothing could be heard of, raises InputError.
    """

    def __init__(
        self,
        spec: str,
        *,
        preset: str = "balanced",
        settings: Mapping[str, Any] | Sequence[str] = (),
        rate_hz: float | None = None,
        seed: int | None = None,
        unit_m: float | None = None,
        simplify_m: float | None = None,
        up: str | None = None,
    ) -> None:
        self._model = _engine.SceneModel(str(spec), preset, _settings(settings), rate_hz, seed, unit_m, simplify_m, up or "")
        self._num_told = 0
        self._tell()

    def _tell(self) -> None:
        """Issues the warnings that are new as a UserWarning each."""
        lines = self._model.warnings
        new, self._num_told = lines[self._num_told :], len(lines)
        for line in new:
            warnings.warn(f"{self.name}: {line}", stacklevel=3)

    def __repr__(self) -> str:
        return f"earshot.Scene({self.name!r}, {self._model.num_triangles} triangles)"

    @property
    def name(self) -> str:
        return self._model.name

    @property
    def num_triangles(self) -> int:
        return self._model.num_triangles

    @property
    def bounds(self) -> Floats:
        """Least and largest coordinates, [2, 3] metres."""
        return np.asarray(self._model.bounds)

    @property
    def sample_rate_hz(self) -> float:
        return self._model.sample_rate_hz

    @property
    def bands_hz(self) -> Floats:
        """Centres of the bands, low to high."""
        return np.asarray(self._model.bands_hz(), dtype=np.float64)

    @property
    def rir_length_s(self) -> float:
        return self._model.rir_length_s()

    @property
    def warnings(self) -> list[str]:
        """What may not be meant about the scene and, since then, about places, one line each; a ``UserWarning`` is issued for each."""
        return self._model.warnings

    @property
    def plan(self) -> list[EffectDecision]:
        """Which effects are simulated in this scene, and why."""
        return [EffectDecision(*line) for line in self._model.plan()]

    def random_positions(self, count: int, *, height_m: float = 1.5, seed: int = 0) -> Floats:
        """Free places on the walkable floor, `height_m` above it: [count, 3].  The first n do not depend on the count."""
        return self._model.random_positions(count, height_m, seed)

    def source(
        self,
        position: ArrayLike,
        *,
        pattern: str = "omni",
        heading_deg: float = 0,
        pitch_deg: float = 0,
        radius_m: float = 0,
    ) -> Source:
        """A source that stands still.

        pattern: omni, subcardioid, cardioid, supercardioid, hypercardioid, dipole, voice, or a balloon file (JSON or YAML); its front is
        at heading and pitch.  radius_m: of the sphere that it fills; 0: a point.
        """
        positions, single = _positions(position, "position")
        if not single:
            raise InputError(f"position: has shape {positions.shape}; give one position [3]")
        x, y, z = (float(value) for value in positions[0])
        return Source(_engine.SourceModel(self._model, x, y, z, str(pattern), heading_deg, pitch_deg, radius_m), self)


def measure(rir: ArrayLike, sample_rate_hz: float, *, direct_delay_s: float = 0) -> Metrics:
    """Room-acoustic parameters of any impulse response [samples] or [channels, samples]: those of the first channel, and with two channels
    the correlation between them.  direct_delay_s: when the direct sound arrives."""
    array = np.ascontiguousarray(rir, dtype=np.float32)
    return Metrics(**_engine.measure_rir(np.atleast_2d(array), sample_rate_hz, direct_delay_s))
