# SPDX-License-Identifier: Apache-2.0
"""Scenes, sources and responses: room impulse responses, their paths and room-acoustic parameters, as numpy arrays.

Positions are in metres in the coordinates of the scene's file, y up.  Angles are in degrees; headings turn counter-clockwise from -z, seen
from above.  Pressure is in Green units: a unit source gives 1 / (4 pi r) at distance r.  Equal arguments and seeds give equal bits for any
number of threads, and the bits of ``earshot rir`` if it is built with the same transforms (docs/howto/python.md).

Scenes, sources and responses pickle by recipe: another process makes them again, with the same bits, and refuses a file that has changed
(of a mesh, a balloon or an array).
"""

from __future__ import annotations

import os
import warnings
import weakref
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arguments as check
from . import _engine
from ._configs import plain_settings
from ._engine import InputError
from ._files import Files, pattern_files, require_same, with_absolute_path
from ._results import ARRIVAL_KINDS, AccuracyChoice, AccuracyPlan, Arrivals, EffectDecision, Floats, Metrics
from .responses import Response, ResponseCall, place_text

if TYPE_CHECKING:
    from .config import Acoustics

__all__ = [
    "ARRIVAL_KINDS",
    "AccuracyChoice",
    "AccuracyPlan",
    "Arrivals",
    "EffectDecision",
    "Floats",
    "Metrics",
    "Response",
    "Scene",
    "Source",
    "measure",
]

PRESETS = ("fast", "balanced", "high")
LONGEST_RADIUS_M = 10.0


def _choice(values: Mapping[str, Any]) -> AccuracyChoice:
    settings = dict(text.split("=", 1) for text in values["settings"])
    return AccuracyChoice(**{**values, "settings": settings})


def _angles(count: int, where: str, **degrees: ArrayLike) -> Floats:
    """[count, 3]"""
    angles = np.empty((count, 3))
    for column, (name, value) in enumerate(degrees.items()):
        array = check.floats(value, where, name)
        if array.shape not in ((), (count,)):
            raise InputError(f"{where}: {name} has shape {array.shape} for {count} listeners; give one number or one per listener")
        angles[:, column] = array
    return angles


def _preset_and_settings(preset: str | None, settings: Any) -> tuple[str, tuple[str, ...]]:
    """The preset of the argument or of the settings, and the settings without it."""
    chosen = None if preset is None else check.one_of(preset, "Scene", "preset", PRESETS)
    others = []
    for text in check.settings(plain_settings(settings, "Scene"), "Scene"):
        key, _, value = text.partition("=")
        if key.strip() != "preset":
            others.append(text)
        elif named := value.strip().strip("\"'"):  # empty: none, as in a config
            check.one_of(named, "Scene", "settings['preset']", PRESETS)
            if chosen not in (None, named):
                raise InputError(f"Scene: preset is {chosen!r} and settings['preset'] is {named!r}; give one of them")
            chosen = named
    return chosen or "balanced", tuple(others)


class Source:
    """A source at a fixed position.  Its paths are computed once.  Calls with 300 or more listeners build a source field if cheaper.

    Later calls of as many listeners use that field; smaller ones do not, so that a result depends on the arguments of its call alone.

    >>> source = Scene("shoebox:6x3x5", preset="fast", settings={"rir_length_s": 0.2}).source([2, 1.5, 2])
    >>> source.render([[4, 1.5, 2], [3, 1.2, 4]], [0, 90], channels="mono").shape
    (2, 1, 3200)
    """

    def __init__(self, scene: Scene, position: Floats, pattern: str, heading_deg: float, pitch_deg: float, radius_m: float) -> None:
        self.scene = scene
        self._recipe = (position, pattern, heading_deg, pitch_deg, radius_m)
        self._files = pattern_files(pattern)
        x, y, z = position.tolist()
        self._model = _engine.SourceModel(scene._model, x, y, z, pattern, heading_deg, pitch_deg, radius_m)

    def __reduce__(self) -> tuple[Any, ...]:
        position, pattern, *rest = self._recipe
        return _source_of, (self.scene, self._files, position, with_absolute_path(pattern, self._files), *rest)

    def __copy__(self) -> Source:
        return self

    def __deepcopy__(self, memo: object) -> Source:
        return self  # nothing of it changes

    def __repr__(self) -> str:
        return f"earshot.Source({place_text(self.position)}, {self._recipe[1]}, in {self.scene.name!r})"

    def _repr_html_(self) -> str:
        from ._html import scene_page

        return scene_page(self.scene, self.position)

    @property
    def position(self) -> Floats:
        """[3] in metres."""
        return self._recipe[0].copy()

    def plot(self, quantity: str = "g_db", *, step_m: float = 0.5, height_m: float = 1.5, ax: Any = None) -> Any:
        """Draw a metric over the rooms of the scene on a grid with matplotlib (extra ``plot``).  Returns the axes.

        :param quantity: "drr_db", or a metric per band, of which the band nearest to 1 kHz is drawn.
        :param step_m: Distance of the grid points.
        :param height_m: Height of the grid above the lowest point of the scene.
        """
        from ._plots import plot_field

        return plot_field(self, quantity, step_m, height_m, ax)

    def render(
        self,
        listener: ArrayLike,
        heading_deg: ArrayLike = 0,
        *,
        pitch_deg: ArrayLike = 0,
        roll_deg: ArrayLike = 0,
        channels: str = "binaural",
        hrtf: str | os.PathLike[str] = "",
        threads: int = 0,
    ) -> NDArray[np.float32]:
        """Render impulse responses: [channels, samples] for one listener [3], [n, channels, samples] for several [n, 3].

        :param channels: ``mono[:PATTERN]``, ``stereo[:xy|:ms|:ab|:ortf]``, ``binaural``, ``quad``, ``surround_5_1``, ``surround_7_1``,
            ``ambisonic:ORDER[:n3d|:sn3d][:world|:ego]`` or ``array:FILE`` (docs/reference/channels.md).
        :param hrtf: SOFA file of the head; empty for a rigid sphere.
        :param threads: Threads over the listeners; 0 uses all cores.
        """
        where = "Source.render"
        positions, single = check.positions(listener, where, "listener")
        angles = _angles(len(positions), where, heading_deg=heading_deg, pitch_deg=pitch_deg, roll_deg=roll_deg)
        names = check.text(channels, where, "channels"), check.path(hrtf, where, "hrtf")
        rirs = self._model.render(positions, angles, *names, check.threads(threads, where))
        self.scene._tell()
        return rirs[0] if single else rirs

    def response(self, listener: ArrayLike, *, channels: str = "binaural") -> Response:
        """Compute the response at one position [3].  channels: layout that it can be rendered to."""
        where = "Source.response"
        return self._respond(ResponseCall(self, check.position(listener, where, "listener"), check.text(channels, where, "channels"), 1))[0]

    def responses(self, listeners: ArrayLike, *, channels: str = "binaural", threads: int = 0) -> list[Response]:
        """Compute the responses at positions [n, 3].  One response that is unpickled brings the whole call with it."""
        where = "Source.responses"
        positions, _ = check.positions(listeners, where, "listeners")
        return self._respond(ResponseCall(self, positions, check.text(channels, where, "channels"), check.threads(threads, where)))

    def _respond(self, call: ResponseCall) -> list[Response]:
        call.models()
        self.scene._tell()
        return [Response(call, index) for index in range(len(call.listeners))]

    def plan_accuracy(self, target: str, listeners: ArrayLike, *, responses: int | None = None) -> AccuracyPlan:
        """Find the cheapest settings that meet ``target`` at positions like ``listeners``, as ``earshot rir --accuracy`` does.

        Keys of the plan, such as rays and field, replace those of the scene; its other settings stay.  Takes seconds.  Raises InputError
        if no settings meet the target.

        :param target: Errors such as "t20=5%,drr=1dB,edc=1dB".
        :param listeners: Positions [3] or [n, 3].
        :param responses: Number of responses of the source; the default is one per listener.
        """
        where = "Source.plan_accuracy"
        positions, _ = check.positions(listeners, where, "listeners")
        if not len(positions):
            raise InputError(f"{where}: listeners is empty; give at least one position")
        count = len(positions) if responses is None else check.integer(responses, where, "responses", 1, 10**12)
        plan = self._model.plan_accuracy(check.text(target, where, "target"), positions, count)
        self.scene._tell()
        tried = [_choice(values) for values in plan["tried"]]
        return AccuracyPlan(tried[plan["chosen"]], tried, plan["reference_error"], plan["calibration_s"])


class Scene:
    """A scene with acoustic settings.

    A source or a listener outside of a closed scene raises InputError.

    :param spec: A mesh file, a point cloud, ``shoebox:XxYxZ[@M]``, ``house:SEED[,key=value]``, ``floor:SEED`` or a scene YAML.
    :param preset: "fast", "balanced" or "high"; the default is that of the settings, else "balanced".
    :param settings: A dict, an ``earshot.config.Acoustics``, a section ``acoustics`` of OmegaConf or texts "key=value" that replace keys
        of the preset, as ``earshot rir --set``.  The key ``preset`` chooses the preset where the argument does not.
    :param unit_m: Metres per unit of a mesh file; the default is that of the scene YAML, else 1.
    :param up: Upward axis of a mesh file, "y" or "z"; the default is that of the scene YAML, else "y".
    :param cell_m: Edge of the voxels of a point cloud in metres; the default is that of the scene YAML, else from its points.

    >>> scene = Scene("shoebox:6x3x5", preset="fast", settings={"rir_length_s": 0.2})
    >>> scene
    earshot.Scene('shoebox:6x3x5', 12 triangles)
    >>> scene.random_positions(2, seed=1).shape
    (2, 3)
    """

    def __init__(
        self,
        spec: str | os.PathLike[str],
        *,
        preset: str | None = None,
        settings: Mapping[str, Any] | Sequence[str] | Acoustics = (),
        rate_hz: float | None = None,
        seed: int | None = None,
        unit_m: float | None = None,
        simplify_m: float | None = None,
        up: str | None = None,
        cell_m: float | None = None,
    ) -> None:
        self._recipe = (
            check.path(spec, "Scene", "spec"),
            *_preset_and_settings(preset, settings),
            None if rate_hz is None else check.number(rate_hz, "Scene", "rate_hz", 8000, 96000),
            None if seed is None else check.seed(seed, "Scene"),
            None if unit_m is None else check.number(unit_m, "Scene", "unit_m", 0, above=True),
            None if simplify_m is None else check.number(simplify_m, "Scene", "simplify_m", 0),
            "" if up is None else check.one_of(up, "Scene", "up", ("y", "z")),
            None if cell_m is None else check.number(cell_m, "Scene", "cell_m", 0, above=True),
        )
        name, of_preset, texts, *_ = self._recipe
        self._model = _engine.SceneModel(name, of_preset, list(texts), *self._recipe[3:])
        self._num_told = 0
        self._tell()
        _SCENES.setdefault(self._key(), self)

    def _key(self) -> tuple[Any, ...]:
        path = os.path.abspath(self._recipe[0]) if os.path.exists(self._recipe[0]) else ""
        return (*self._recipe, path, self._model.hash)

    def __reduce__(self) -> tuple[Any, ...]:
        return _scene_of, (self._key(),)

    def __copy__(self) -> Scene:
        return self

    def __deepcopy__(self, memo: object) -> Scene:
        return self  # nothing of it changes

    def _tell(self) -> None:
        """Issue each new warning as a UserWarning."""
        lines = self._model.warnings
        new, self._num_told = lines[self._num_told :], len(lines)
        for line in new:
            warnings.warn(f"{self.name}: {line}", stacklevel=3)

    def __repr__(self) -> str:
        return f"earshot.Scene({self.name!r}, {self._model.num_triangles} triangles)"

    def _repr_html_(self) -> str:
        from ._html import scene_page

        return scene_page(self)

    def plot(self, ax: Any = None, *, points: ArrayLike | None = None, path: ArrayLike | None = None) -> Any:
        """Draw the floor plan of the scene with matplotlib (extra ``plot``).  Returns the axes.

        :param points: Positions [n, 3] to mark.
        :param path: Positions [n, 3] to join, such as those of an episode (``Batch.pose``).
        """
        from ._plots import plot_scene

        return plot_scene(self, ax, points, path)

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

    def section(self, height_m: float | None = None) -> Floats:
        """Return the lines in which the surfaces cross a level plane, as a floor plan shows walls: [segments, 2, 3].

        :param height_m: Coordinate y of the plane; the default is 1.2 m above the lowest point, or the middle of a lower scene.
        """
        low, high = self.bounds[:, 1]
        height = min(low + 1.2, (low + high) / 2) if height_m is None else check.number(height_m, "Scene.section", "height_m")
        return self._model.section(float(height))

    def random_positions(self, count: int, *, height_m: float = 1.5, seed: int = 0) -> Floats:
        """Return free positions [count, 3] at ``height_m`` above the walkable floor.  The first n do not depend on ``count``."""
        where = "Scene.random_positions"
        places = check.integer(count, where, "count", 0, 1_000_000)
        return self._model.random_positions(places, check.number(height_m, where, "height_m", 0, 10, above=True), check.seed(seed, where))

    def source(
        self,
        position: ArrayLike,
        *,
        pattern: str | os.PathLike[str] = "omni",
        heading_deg: float = 0,
        pitch_deg: float = 0,
        radius_m: float = 0,
    ) -> Source:
        """Place a source in the scene.

        :param position: Position [3].
        :param pattern: "omni", "subcardioid", "cardioid", "supercardioid", "hypercardioid", "dipole", "voice", or a file: a balloon
            (JSON or YAML), SOFA (FreeFieldDirectivityTF) or CLF text.  Its front points to ``heading_deg`` and ``pitch_deg``.
        :param radius_m: Radius of a spherical source; 0 for a point.
        """
        where = "Scene.source"
        return Source(
            self,
            check.position(position, where, "position")[0],
            check.path(pattern, where, "pattern"),
            check.number(heading_deg, where, "heading_deg"),
            check.number(pitch_deg, where, "pitch_deg"),
            check.number(radius_m, where, "radius_m", 0, LONGEST_RADIUS_M),
        )


#: Scenes that are alive, so that what travels together shares one.
_SCENES: weakref.WeakValueDictionary[tuple[Any, ...], Scene] = weakref.WeakValueDictionary()


def _scene_of(key: tuple[Any, ...]) -> Scene:
    """The scene of a recipe; refuses one whose content has changed since it was pickled."""
    if (alive := _SCENES.get(key)) is not None and alive._key() == key:
        return alive
    spec, preset, settings, rate_hz, seed, unit_m, simplify_m, up, cell_m, path, content = key
    if path and os.path.abspath(spec) != path:
        spec = path  # pickled in another folder
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # told where the scene was made
        scene = Scene(
            spec,
            preset=preset,
            settings=settings,
            rate_hz=rate_hz,
            seed=seed,
            unit_m=unit_m,
            simplify_m=simplify_m,
            up=up or None,
            cell_m=cell_m,
        )
    if scene._model.hash != content:
        raise InputError(f"{scene.name}: has changed since the scene was pickled; pickle it again")
    return scene


def _source_of(scene: Scene, files: Files, *recipe: Any) -> Source:
    """The source of a recipe; refuses a balloon that has changed since it was pickled."""
    source = Source(scene, *recipe)
    require_same(files, source._files, "the source was pickled")
    return source


def _samples(value: ArrayLike, name: str) -> NDArray[np.float32]:
    """Of any shape, finite."""
    array = check.floats(value, "measure", name)
    with np.errstate(over="ignore"):
        samples = array.astype(np.float32)
    if not np.isfinite(samples).all():
        raise InputError(f"measure: {name} has values beyond the range of float32")
    return samples


def _beside(value: ArrayLike | None, name: str) -> NDArray[np.float32]:
    """Samples of one microphone; none: empty."""
    samples = np.empty(0, np.float32) if value is None else _samples(value, name)
    if samples.ndim != 1 or (value is not None and samples.size == 0):
        raise InputError(f"measure: {name} has shape {samples.shape}; give [samples]")
    return samples


def measure(
    rir: ArrayLike,
    sample_rate_hz: float,
    *,
    direct_delay_s: float | None = None,
    bands: str = "octaves",
    parameters: Sequence[str] = (),
    speech_snr_db: ArrayLike = (),
    lateral: ArrayLike | None = None,
    reference: ArrayLike | None = None,
    green_units: bool = False,
    distance_m: float | None = None,
) -> Metrics:
    """Compute room-acoustic parameters of an impulse response [samples] or [channels, samples].

    The parameters are those of the first channel; two channels also give the interaural cross-correlation.

    :param direct_delay_s: Arrival time of the direct sound; by default the first sample within 20 dB of the strongest that stands above
        the noise (ISO 3382-1).
    :param bands: "octaves" from 63 Hz to 16 kHz, as far as the rate reaches, or "third_octaves" from 100 Hz to 10 kHz.
    :param parameters: Groups of "lateral" (J_LF, J_LFC, LG), "stage" (ST_early, ST_late) and "speech" (MTI, STI).
    :param speech_snr_db: Ratio of speech to noise for STI: one number, or seven from 125 Hz to 8 kHz; none by default.
    :param lateral: Response [samples] of a figure-of-eight microphone, its null toward the source, for "lateral".
    :param reference: Response [samples] of the same source and microphone at 10 m in a free field, for G and LG.
    :param green_units: The samples are in Green units, as :meth:`Response.render` gives them, so that G and LG need no reference.
    :param distance_m: Distance of the source, for "stage"; 1 by default.

    >>> decay = 10 ** (-3 * np.arange(16000) / 16000 / 0.5)  # 60 dB in half a second
    >>> noise = np.random.default_rng(1).standard_normal(16000)
    >>> metrics = measure(noise * decay, 16000)
    >>> bool(abs(metrics.t20_s[metrics.bands_hz == 1000][0] - 0.5) < 0.05)
    True
    """
    where = "measure"
    array = _samples(rir, "rir")
    if array.ndim not in (1, 2) or array.size == 0:
        raise InputError(f"measure: rir has shape {array.shape}; give [samples] or [channels, samples]")
    return Metrics(
        **_engine.measure_rir(
            np.atleast_2d(array),
            check.number(sample_rate_hz, where, "sample_rate_hz", 100, 1e7),
            None if direct_delay_s is None else check.number(direct_delay_s, where, "direct_delay_s", 0),
            check.one_of(bands, where, "bands", ("octaves", "third_octaves")),
            *check.parameters(parameters, speech_snr_db, where),
            _beside(lateral, "lateral"),
            _beside(reference, "reference"),
            check.flag(green_units, where, "green_units"),
            None if distance_m is None else check.number(distance_m, where, "distance_m", 0, above=True),
        )
    )
