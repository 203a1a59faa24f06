# SPDX-License-Identifier: Apache-2.0
"""Scenes, sources and responses: room impulse responses, their paths and room-acoustic parameters, as numpy arrays.

Positions are in metres in the coordinates of the scene's file, y up.  Angles are in degrees; headings turn counter-clockwise from -z, seen
from above.  Pressure is in Green units: a unit source gives 1 / (4 pi r) at distance r.  Equal arguments and seeds give equal bits for any
number of threads, and the bits of ``earshot rir`` if it is built with the same transforms (docs/howto/python.md).
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
    """One decision of the effect plan: whether an effect is simulated in a scene, and the reason."""

    effect: str
    decision: str
    on: bool
    change: float  #: largest change of a response if the effect is off; NaN if not estimated
    unit: str
    kind: str  #: basis of the decision: exact, bounded, approximated, user_set
    saved_ms: float
    why: str


@dataclass(frozen=True)
class Metrics:
    """Room-acoustic parameters after ISO 3382-1, one value per band; NaN for an undefined value (no decay to fit, no direct sound)."""

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
    iacc: Floats  #: this and the next two: binaural RIRs only
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
    identity: NDArray[np.uint64]  #: [n], identifies the planes or edges; a path keeps its number when the listener moves
    delay_s: Floats  #: [n], after emission
    distance_m: NDArray[np.float32]  #: [n]
    direction: NDArray[np.float32]  #: [n, 3], unit vector from the listener to the incoming sound
    departure: NDArray[np.float32]  #: [n, 3], unit vector from the source along the outgoing sound
    amplitude: NDArray[np.float32]  #: [n, b], pressure in Green units
    phase_rad: NDArray[np.float32]  #: [n, b], in addition to the phase of the delay

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def kind_names(self) -> list[str]:
        return [ARRIVAL_KINDS[kind] for kind in self.kind]


@dataclass(frozen=True)
class AccuracyChoice:
    """Settings for the responses of a source, tested at a few listeners."""

    method: str  #: listener rays, source field or both ends
    settings: dict[str, str]  #: for ``Scene(settings=...)``
    predicted: dict[str, float]  #: errors at other listeners: t20_pct, drr_db, edc_db; NaN if undefined
    per_source_ms: float
    per_response_ms: float


@dataclass(frozen=True)
class AccuracyPlan:
    """The cheapest settings that meet a target accuracy, and all tested settings."""

    choice: AccuracyChoice
    tried: list[AccuracyChoice]  #: in the order of trial
    reference_error: dict[str, float]  #: standard error of the reference paths
    calibration_s: float


def _choice(values: Mapping[str, Any]) -> AccuracyChoice:
    settings = dict(text.split("=", 1) for text in values["settings"])
    return AccuracyChoice(**{**values, "settings": settings})


def _positions(value: ArrayLike, key: str) -> tuple[Floats, bool]:
    """Return the positions as [n, 3], and whether the value was a single position."""
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
    """Energy response of one source and one listener, before a head or microphone.  It does not depend on the listener's orientation."""

    def __init__(self, model: _engine.ResponseModel, channels: str) -> None:
        self._model = model
        self._channels = channels

    @cached_property
    def arrivals(self) -> Arrivals:
        return Arrivals(**self._model.arrivals())

    @cached_property
    def metrics(self) -> Metrics:
        """Parameters from the energy response: exact times, without carrier noise."""
        return Metrics(**self._model.metrics())

    @property
    def late(self) -> NDArray[np.float32]:
        """Energy of the late field, a read-only view [time bins, bands, harmonics]."""
        return self._model.late()

    @property
    def bin_s(self) -> float:
        """Length of a time bin of ``late`` in seconds; the first bin starts at emission."""
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
        """Render the impulse response [channels, samples] for this orientation of the listener.

        :param channels: Channel layout; the default is that of :meth:`Source.response`.
        """
        return self._model.render(heading_deg, pitch_deg, roll_deg, channels or self._channels, str(hrtf))


class Source:
    """A source at a fixed position.  Its paths are computed once.  Calls with 300 or more listeners build a source field if cheaper."""

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
        """Render impulse responses: [channels, samples] for one listener [3], [n, channels, samples] for several [n, 3].

        :param channels: ``mono[:PATTERN]``, ``binaural``, ``ambisonic:ORDER[:n3d|:sn3d][:world|:ego]`` or ``array:FILE``.
        :param hrtf: SOFA file of the head; empty for a rigid sphere.
        :param threads: Threads over the listeners; 0 uses all cores.
        """
        positions, single = _positions(listener, "listener")
        angles = _angles(len(positions), heading_deg, pitch_deg, roll_deg)
        rirs = self._model.render(positions, angles, channels, str(hrtf), threads)
        self.scene._tell()
        return rirs[0] if single else rirs

    def response(self, listener: ArrayLike, *, channels: str = "binaural") -> Response:
        """Compute the response at one position.  channels: layout that it can be rendered to."""
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
        """Find the cheapest settings that meet ``target`` at positions like ``listeners``, as ``earshot rir --accuracy`` does.

        Keys of the plan, such as rays and field, replace those of the scene; its other settings stay.  Takes seconds.  Raises InputError
        if no settings meet the target.

        :param target: Errors such as "t20=5%,drr=1dB,edc=1dB".
        :param listeners: Positions [3] or [n, 3].
        :param responses: Number of responses of the source; the default is one per listener.
        """
        positions, _ = _positions(listeners, "listeners")
        plan = self._model.plan_accuracy(target, positions, len(positions) if responses is None else responses)
        tried = [_choice(values) for values in plan["tried"]]
        return AccuracyPlan(tried[plan["chosen"]], tried, plan["reference_error"], plan["calibration_s"])


class Scene:
    """A scene with acoustic settings.

    A source or a listener outside of a closed scene raises InputError.

    :param spec: A mesh file, ``shoebox:XxYxZ[@M]``, ``house:SEED[,key=value]``, ``floor:SEED`` or a scene YAML.
    :param preset: "fast", "balanced" or "high".
    :param settings: A dict or texts "key=value" that replace keys of the preset, as ``earshot rir --set``.
    :param unit_m: Metres per unit of a mesh file; the default is that of the scene YAML, else 1.
    :param up: Upward axis of a mesh file, "y" or "z"; the default is that of the scene YAML, else "y".
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
        """Issue each new warning as a UserWarning."""
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
        """Minimum and maximum coordinates, [2, 3] in metres."""
        return np.asarray(self._model.bounds)

    @property
    def sample_rate_hz(self) -> float:
        return self._model.sample_rate_hz

    @property
    def bands_hz(self) -> Floats:
        """Centre frequencies of the bands in ascending order."""
        return np.asarray(self._model.bands_hz(), dtype=np.float64)

    @property
    def rir_length_s(self) -> float:
        return self._model.rir_length_s()

    @property
    def warnings(self) -> list[str]:
        """Warnings about the scene and about positions, one line each.  Each is also issued as a ``UserWarning``."""
        return self._model.warnings

    @property
    def plan(self) -> list[EffectDecision]:
        """Effects that are simulated in this scene, with the reasons."""
        return [EffectDecision(*line) for line in self._model.plan()]

    def random_positions(self, count: int, *, height_m: float = 1.5, seed: int = 0) -> Floats:
        """Return free positions [count, 3] at ``height_m`` above the walkable floor.  The first n do not depend on ``count``."""
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
        """Place a source in the scene.

        :param position: Position [3].
        :param pattern: "omni", "subcardioid", "cardioid", "supercardioid", "hypercardioid", "dipole", "voice", or a balloon file (JSON or
            YAML).  Its front points to ``heading_deg`` and ``pitch_deg``.
        :param radius_m: Radius of a spherical source; 0 for a point.
        """
        positions, single = _positions(position, "position")
        if not single:
            raise InputError(f"position: has shape {positions.shape}; give one position [3]")
        x, y, z = (float(value) for value in positions[0])
        return Source(_engine.SourceModel(self._model, x, y, z, str(pattern), heading_deg, pitch_deg, radius_m), self)


def measure(rir: ArrayLike, sample_rate_hz: float, *, direct_delay_s: float = 0) -> Metrics:
    """Compute room-acoustic parameters of an impulse response [samples] or [channels, samples].

    The parameters are those of the first channel; two channels also give the interaural cross-correlation.

    :param direct_delay_s: Arrival time of the direct sound.
    """
    array = np.ascontiguousarray(rir, dtype=np.float32)
    return Metrics(**_engine.measure_rir(np.atleast_2d(array), sample_rate_hz, direct_delay_s))
