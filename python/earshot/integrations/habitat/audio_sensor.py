# SPDX-License-Identifier: Apache-2.0
"""A sensor with the methods of the original's audio sensor, for scripts that drive it by hand::

    from earshot.integrations.habitat import AudioSensor

    sensor = AudioSensor("mp3d/scene.glb")
    sensor.setAudioSourceTransform([2.0, 1.5, -3.0])
    sensor.setAudioListenerTransform([0.0, 1.5, 0.0], [1, 0, 0, 0])
    sensor.runSimulation(None)
    rir = sensor.getIR()  # float32 [channels, samples]

It needs NumPy alone.
"""

from __future__ import annotations

import json
import math
import os
import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..._engine import InputError, RunError
from ..._wav import wav
from ...acoustics import Scene, Source
from ...responses import Response
from ._episodes import scene_of

#: Height of the ears above an agent of a simulator, in metres.
EAR_HEIGHT_M = 1.5


class AudioSensor:
    """One source and one listener in a scene.  Materials stay through reset(); the source is seen from the source towards the listener.

    :param scene: As of ``earshot.Scene``; None: runSimulation() takes the scene of the simulator.
    :param channels: "binaural", "mono", "ambisonics_1", ... (docs/reference/channels.md).
    :param options: Further arguments of ``earshot.Scene``: preset, settings, rate_hz, seed.
    """

    def __init__(self, scene: str | os.PathLike[str] | None = None, channels: str = "binaural", **options: Any) -> None:
        self._spec = None if scene is None else os.fspath(scene)
        self._channels = channels
        self._options: Mapping[str, Any] = {"preset": "fast", **options}
        self._hrtf = ""
        self._materials: Path | None = None
        self._loaded: tuple[Any, Scene] | None = None
        self._source_at: NDArray[np.float64] | None = None
        self._listener_at: NDArray[np.float64] | None = None
        self._angles_deg = (0.0, 0.0, 0.0)
        self._source: Source | None = None
        self._response: Response | None = None
        self._rir: NDArray[np.float32] | None = None

    def reset(self) -> None:
        """Forgets source, listener and response; scene, materials and HRTF stay."""
        self._source_at = self._listener_at = self._source = self._response = self._rir = None

    def setAudioSourceTransform(self, position: ArrayLike) -> None:  # noqa: N802  # a name of the original
        """position: [3], of the source itself."""
        self._source_at = _position(position, "setAudioSourceTransform")
        self._source = None

    def setAudioListenerTransform(self, position: ArrayLike, rotation: ArrayLike) -> None:  # noqa: N802
        """position: [3], of the ears.  rotation: [w, x, y, z], from the axes of the head (right, up, back) to those of the scene."""
        self._listener_at = _position(position, "setAudioListenerTransform")
        self._angles_deg = angles_deg(rotation)

    def setAudioMaterialsJSON(self, path: str | os.PathLike[str]) -> None:  # noqa: N802
        """A material database, by whose labels the categories of the scene take materials; at any time."""
        if not Path(path).is_file():
            raise InputError(f"setAudioMaterialsJSON: {path} is no file; name a material database (docs/reference/formats.md)")
        self._materials = Path(path).absolute()

    def setListenerHRTF(self, path: str | os.PathLike[str]) -> None:  # noqa: N802
        """path: a SOFA file; "": the rigid sphere."""
        self._hrtf = os.fspath(path)

    def runSimulation(self, sim: Any = None) -> None:  # noqa: N802
        """Simulates the response.  sim: gives the scene, and the place of the agent, where they were not set; None else."""
        if self._source_at is None:
            raise RunError("runSimulation: there is no source; call setAudioSourceTransform first")
        if self._listener_at is None:
            if sim is None:
                raise RunError("runSimulation: there is no listener; call setAudioListenerTransform first")
            state = sim.get_agent_state()
            place = np.asarray(state.position, dtype=np.float64) + np.array([0, EAR_HEIGHT_M, 0])
            angles = angles_deg([state.rotation.w, state.rotation.x, state.rotation.y, state.rotation.z])
        else:
            place, angles = self._listener_at, self._angles_deg
        scene = self._scene(sim)
        if self._source is None:
            self._source = scene.source(self._source_at)
        self._response = self._source.response(place, channels=self._channels)
        heading, pitch, roll = angles
        self._rir = self._response.render(heading, pitch_deg=pitch, roll_deg=roll, channels=self._channels, hrtf=self._hrtf)

    def getIR(self) -> NDArray[np.float32]:  # noqa: N802
        """[channels, samples], of the same length in each call; at 1 m the direct sound of a source has the pressure 1 / (4 pi)."""
        return self._done("getIR").copy()

    def writeIRWave(self, path: str | os.PathLike[str]) -> None:  # noqa: N802
        """A WAV file of float32."""
        rir = self._done("writeIRWave")
        assert self._loaded is not None
        Path(path).write_bytes(wav(rir, self._loaded[1].sample_rate_hz))

    def getRayEfficiency(self) -> float:  # noqa: N802
        """The fraction of the rays that no hole of the mesh has lost, in [0, 1]."""
        self._done("getRayEfficiency")
        assert self._response is not None
        return float(self._response.ray_efficiency)

    def sourceIsVisible(self) -> bool:  # noqa: N802
        """Whether nothing stands between source and listener."""
        self._done("sourceIsVisible")
        assert self._response is not None
        return "direct" in self._response.arrivals.kind_names

    def _done(self, method: str) -> NDArray[np.float32]:
        if self._rir is None:
            raise RunError(f"{method}: there is no response; call runSimulation first")
        return self._rir

    def _scene(self, sim: Any) -> Scene:
        config: Any = getattr(sim, "habitat_config", None)
        if self._spec is None and config is None:
            raise RunError("runSimulation: there is no scene; make the sensor with one, or pass a simulator")
        spec = self._spec if self._spec is not None else scene_of(config.scene, config.get("mesh", ""))
        key = (spec, self._materials)
        if self._loaded is None or self._loaded[0] != key:
            self._source = None
            self._loaded = (key, self._load(spec))
        return self._loaded[1]

    def _load(self, spec: str) -> Scene:
        if self._materials is None:
            return Scene(spec, **self._options)
        mesh, keys = _mesh_and_keys(spec)
        if mesh.endswith((".yaml", ".yml")) or not Path(mesh).is_file():
            raise InputError(f"setAudioMaterialsJSON: scene {spec} is no mesh file; name the materials in its scene YAML")
        with tempfile.TemporaryDirectory(prefix="earshot_scene_") as folder:
            text: dict[str, Any] = {"mesh": os.path.abspath(mesh), "materials": str(self._materials), **keys}
            file = Path(folder) / "scene.yaml"
            file.write_text(json.dumps(text), encoding="utf-8")
            return Scene(file, **self._options)


def _mesh_and_keys(spec: str) -> tuple[str, dict[str, Any]]:
    """File of a scene such as "room.obj,unit=0.01,up=z", and its options as keys of a scene YAML."""
    keys: dict[str, Any] = {}
    while found := re.fullmatch(r"(.*),(unit|up)=([^,]*)", spec, re.DOTALL):
        spec, key, value = found.groups()
        if key == "up":
            keys.setdefault("up", value)
            continue
        try:
            keys.setdefault("unit_m", float(value))
        except ValueError:
            raise InputError(f"setAudioMaterialsJSON: unit of the scene is {value!r}; give metres, as in unit=0.01") from None
    return spec, keys


def angles_deg(rotation: ArrayLike) -> tuple[float, float, float]:
    """Heading counter-clockwise from -z, pitch (nose up) and roll (right ear down) of a quaternion [w, x, y, z]."""
    q = np.asarray(rotation, dtype=np.float64)
    if q.shape != (4,) or not np.isfinite(q).all() or not np.linalg.norm(q) > 1e-6:
        raise InputError(f"rotation is {np.asarray(rotation).tolist()}; give a quaternion [w, x, y, z] that is not zero")
    w, x, y, z = q / np.linalg.norm(q)
    right = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    up_y = 1 - 2 * (x * x + z * z)
    ahead = (-2 * (x * z + w * y), -2 * (y * z - w * x), -(1 - 2 * (x * x + y * y)))
    pitch = math.asin(max(-1.0, min(1.0, ahead[1])))
    if abs(ahead[1]) > 1 - 1e-9:  # straight up or down: heading and roll are the same turn
        return math.degrees(math.atan2(-right[2], right[0])), math.degrees(pitch), 0.0
    heading = math.atan2(-ahead[0], -ahead[2])
    return math.degrees(heading), math.degrees(pitch), math.degrees(math.atan2(-right[1], up_y))


def _position(position: ArrayLike | Sequence[float], method: str) -> NDArray[np.float64]:
    place = np.asarray(position, dtype=np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InputError(f"{method}: position is {place.tolist()}; give three finite numbers")
    return place
