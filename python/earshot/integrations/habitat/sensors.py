# SPDX-License-Identifier: Apache-2.0
"""Sensors of the simulator, and of a task those that hear.

A sensor of the simulator takes its numbers out of the arrays of the engine.  Types of Habitat-Lab's own cameras ("HabitatSimRGBSensor")
work as well: the simulator puts those of Earshot in their place.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gym import spaces
from habitat.core.registry import registry
from habitat.core.simulator import DepthSensor, RGBSensor, SemanticSensor, Sensor, SensorTypes
from numpy.typing import NDArray

Arrays = Mapping[str, NDArray[Any]]
Table = Mapping[str, spaces.Box]


class _EngineSensor:
    """array: name of the engine's array, whose space the table has."""

    array = ""
    space: spaces.Box

    def attach(self, array: str, uuid: str, table: Table) -> None:
        self.array = array
        self.uuid = uuid
        self.observation_space = self._space(table[array])

    def _space(self, box: spaces.Box) -> spaces.Box:
        return box

    def _get_observation_space(self, *args: Any, **kwargs: Any) -> spaces.Box | None:
        return None

    def get_observation(self, arrays: Arrays, *args: Any, **kwargs: Any) -> NDArray[Any]:
        return arrays[self.array].copy()


@registry.register_sensor
class EarshotRGBSensor(_EngineSensor, RGBSensor):
    """uint8 [height, width, 3]."""


@registry.register_sensor
class EarshotDepthSensor(_EngineSensor, DepthSensor):
    """float32 [height, width, 1]: metres clipped to min_depth and max_depth, with normalize_depth as a fraction of this range."""

    def _space(self, box: spaces.Box) -> spaces.Box:
        self._least, self._most = float(self.config.min_depth), float(self.config.max_depth)
        low, high = (0.0, 1.0) if self.config.normalize_depth else (self._least, self._most)
        return spaces.Box(low, high, box.shape, np.float32)

    def get_observation(self, arrays: Arrays, *args: Any, **kwargs: Any) -> NDArray[Any]:
        depth = arrays[self.array]
        if self.config.normalize_depth and self._least == 0:
            return depth.copy()
        metres = np.clip(depth * np.float32(self._most), self._least, self._most)
        return (metres - self._least) / np.float32(self._most - self._least) if self.config.normalize_depth else metres


@registry.register_sensor
class EarshotSemanticSensor(_EngineSensor, SemanticSensor):
    """int32 [height, width, 1]: numbers of categories, not of objects."""

    def _space(self, box: spaces.Box) -> spaces.Box:
        return spaces.Box(0, np.iinfo(np.uint16).max, box.shape, np.int32)

    def get_observation(self, arrays: Arrays, *args: Any, **kwargs: Any) -> NDArray[Any]:
        return arrays[self.array].astype(np.int32)


class _Hearing(_EngineSensor, Sensor):
    def _get_sensor_type(self, *args: Any, **kwargs: Any) -> SensorTypes:
        return SensorTypes.PATH

    def _get_uuid(self, *args: Any, **kwargs: Any) -> str:
        return "audiogoal" if self.heard == "heard" else self.heard

    heard = ""


@registry.register_sensor
class EarshotAudioGoalSensor(_Hearing):
    """float32 [channels, samples]: the sound at the ears in the last second, whole."""

    heard = "heard"


@registry.register_sensor
class EarshotSpectrogramSensor(_Hearing):
    """float32 [65, columns, channels]: log(1 + magnitude) of the last second."""

    heard = "spectrogram"


class _HearingOfTask(_Hearing):
    """A task's sensor: turns the array on in the simulator, and reads it there."""

    def __init__(self, *args: Any, sim: Any, config: Any, **kwargs: Any) -> None:
        self._sim = sim
        super().__init__(*args, config=config, **kwargs)
        if not hasattr(sim, "turn_on"):
            raise TypeError(f"sensor {config.type} needs the simulator Earshot-v0, not {type(sim).__name__}")
        self.attach(self.heard, self.uuid, sim.turn_on(self.heard))

    def get_observation(self, *args: Any, **kwargs: Any) -> NDArray[Any]:
        return super().get_observation(self._sim.arrays)


@registry.register_sensor
class AudioGoalSensor(_HearingOfTask):
    heard = "heard"


@registry.register_sensor
class SpectrogramSensor(_HearingOfTask):
    heard = "spectrogram"


OF_KIND = {
    "rgb": EarshotRGBSensor,
    "depth": EarshotDepthSensor,
    "semantic": EarshotSemanticSensor,
    "heard": EarshotAudioGoalSensor,
    "spectrogram": EarshotSpectrogramSensor,
}
