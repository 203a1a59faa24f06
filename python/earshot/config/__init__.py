# SPDX-License-Identifier: Apache-2.0
"""Configs as dataclasses: every key with its default, as ``earshot config`` prints them.

>>> config = EnvConfig(episodes=Episodes(scenes=["house:1"], sounds=["synth:telephone"]), acoustics=Acoustics(preset="fast"))
>>> config.task.max_steps
500
>>> config.task.max_steps = 200
>>> print(to_yaml(config), end="")
task:
  max_steps: 200
acoustics:
  preset: "fast"
episodes:
  scenes: ["house:1"]
  sounds: ["synth:telephone"]

A config has the keys whose values differ from the defaults.  A key that is None follows other keys, in ``acoustics`` the preset, or a
file.  ``randomize`` and ``panorama`` are off where they are None; an instance, as ``Randomize()``, switches them on.  The classes are
structured configs of OmegaConf and Hydra.
"""

from ._yaml import to_yaml
from .acoustics import Acoustics, CorpusAcoustics
from .corpora import Panorama, Randomize, RecordingCorpusConfig, ResponseCorpusConfig, Shoeboxes
from .envs import (
    ActuationNoise,
    Agents,
    Camera,
    EnvConfig,
    Episodes,
    Filter,
    Map,
    MountedCamera,
    Navmesh,
    Noise,
    Observation,
    Scenario,
    Task,
)
from .runs import Data, Env, Guidance, HeldOut, Network, Policy, Ppo, RunConfig, TrainingEpisodes
from .scenes import Air, SceneConfig, SceneRandomize

__all__ = [
    "Acoustics",
    "ActuationNoise",
    "Agents",
    "Air",
    "Camera",
    "CorpusAcoustics",
    "Data",
    "Env",
    "EnvConfig",
    "Episodes",
    "Filter",
    "Guidance",
    "HeldOut",
    "Map",
    "MountedCamera",
    "Navmesh",
    "Network",
    "Noise",
    "Observation",
    "Panorama",
    "Policy",
    "Ppo",
    "Randomize",
    "RecordingCorpusConfig",
    "ResponseCorpusConfig",
    "RunConfig",
    "Scenario",
    "SceneConfig",
    "SceneRandomize",
    "Shoeboxes",
    "Task",
    "TrainingEpisodes",
    "to_yaml",
]
