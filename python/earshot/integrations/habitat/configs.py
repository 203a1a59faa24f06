# SPDX-License-Identifier: Apache-2.0
"""Structured configs, for the defaults lists of Hydra.

===============================  =====================================================================
group                            names
===============================  =====================================================================
habitat/simulator                earshot
habitat/simulator/sim_sensors    earshot_rgb, earshot_depth, earshot_semantic, earshot_audiogoal,
                                 earshot_spectrogram
habitat/task/measurements        earshot_distance_to_goal, normalized_distance_to_goal, sna,
                                 success_when_silent, number_of_action
habitat/task/lab_sensors         earshot_audiogoal_sensor, earshot_spectrogram_sensor
===============================  =====================================================================
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from habitat.config import default_structured_configs as lab
from hydra.core.config_store import ConfigStore
from omegaconf import II


@dataclass
class EarshotSimulatorConfig(lab.SimulatorConfig):
    """earshot: keys of the section ``env`` of Earshot (``earshot config env``), over those that follow from Habitat-Lab's keys.

    mesh: of the files of scenes, "up=z" or "unit=0.01,up=z", as in a SCENE; without it they are in metres, y up.
    """

    type: str = "Earshot-v0"
    mesh: str = ""
    max_episode_steps: int = II("habitat.environment.max_episode_steps")
    earshot: dict[str, Any] = field(default_factory=dict)


@dataclass
class EarshotRGBSensorConfig(lab.HabitatSimRGBSensorConfig):
    type: str = "EarshotRGBSensor"
    height: int = 128
    width: int = 128


@dataclass
class EarshotDepthSensorConfig(lab.HabitatSimDepthSensorConfig):
    type: str = "EarshotDepthSensor"
    height: int = 128
    width: int = 128


@dataclass
class EarshotSemanticSensorConfig(lab.HabitatSimSemanticSensorConfig):
    type: str = "EarshotSemanticSensor"
    height: int = 128
    width: int = 128


@dataclass
class EarshotAudioGoalSensorConfig(lab.HabitatBaseConfig):
    type: str = "EarshotAudioGoalSensor"
    uuid: str = "audiogoal"


@dataclass
class EarshotSpectrogramSensorConfig(lab.HabitatBaseConfig):
    type: str = "EarshotSpectrogramSensor"
    uuid: str = "spectrogram"


@dataclass
class AudioGoalLabSensorConfig(lab.LabSensorConfig):
    type: str = "AudioGoalSensor"


@dataclass
class SpectrogramLabSensorConfig(lab.LabSensorConfig):
    type: str = "SpectrogramSensor"


@dataclass
class EarshotDistanceToGoalConfig(lab.MeasurementConfig):
    type: str = "EarshotDistanceToGoal"


@dataclass
class NormalizedDistanceToGoalConfig(lab.MeasurementConfig):
    type: str = "NormalizedDistanceToGoal"


@dataclass
class SNAConfig(lab.MeasurementConfig):
    type: str = "SNA"


@dataclass
class SuccessWhenSilentConfig(lab.MeasurementConfig):
    type: str = "SuccessWhenSilent"


@dataclass
class NumberOfActionConfig(lab.MeasurementConfig):
    type: str = "NumberOfAction"


_SENSORS = {
    "earshot_rgb": EarshotRGBSensorConfig,
    "earshot_depth": EarshotDepthSensorConfig,
    "earshot_semantic": EarshotSemanticSensorConfig,
    "earshot_audiogoal": EarshotAudioGoalSensorConfig,
    "earshot_spectrogram": EarshotSpectrogramSensorConfig,
}
#: By the name of the config: the key that it takes in the config, and its node.
_MEASUREMENTS = {
    "earshot_distance_to_goal": ("distance_to_goal", EarshotDistanceToGoalConfig),
    "normalized_distance_to_goal": ("normalized_distance_to_goal", NormalizedDistanceToGoalConfig),
    "sna": ("sna", SNAConfig),
    "success_when_silent": ("success_when_silent", SuccessWhenSilentConfig),
    "number_of_action": ("number_of_action", NumberOfActionConfig),
}
_LAB_SENSORS = {
    "earshot_audiogoal_sensor": ("audiogoal", AudioGoalLabSensorConfig),
    "earshot_spectrogram_sensor": ("spectrogram", SpectrogramLabSensorConfig),
}


def register() -> None:
    store = ConfigStore.instance()
    store.store(package="habitat.simulator", group="habitat/simulator", name="earshot", node=EarshotSimulatorConfig)
    for name, node in _SENSORS.items():
        store.store(group="habitat/simulator/sim_sensors", name=name, node=node)
    for part, configs in (("measurements", _MEASUREMENTS), ("lab_sensors", _LAB_SENSORS)):
        for name, (key, node) in configs.items():
            store.store(package=f"habitat.task.{part}.{key}", group=f"habitat/task/{part}", name=name, node=node)
