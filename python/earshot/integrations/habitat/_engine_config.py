# SPDX-License-Identifier: Apache-2.0
"""Keys of Habitat-Lab's simulator config as a config of the engine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from omegaconf import OmegaConf

from ..._engine import InputError
from ._episodes import check_scene_dataset

PICTURES = {"RGB": "rgb", "Depth": "depth", "Semantic": "semantic"}
HEARD = {"EarshotAudioGoalSensor": "heard", "EarshotSpectrogramSensor": "spectrogram"}
#: Any episode does: a batch is made of it for the table of its sensors alone.
TRIAL_EPISODE = {
    "scenes": ["shoebox:4x2.5x4"],
    "sounds": ["synth:telephone"],
    "episodes_per_scene": 1,
    "filter": {"min_geodesic_m": 0.5, "min_ratio": 0},
}
MAX_STEPS = 1_000_000


@dataclass(frozen=True)
class Camera:
    """Of one or more sensors of the simulator."""

    width: int
    height: int
    hfov: float
    projection: str
    position: tuple[float, float, float]
    orientation: tuple[float, float, float]
    max_depth: float

    def is_main(self) -> bool:
        """Whether the engine's main camera does: level, ahead, above the agent."""
        level = self.position[0] == self.position[2] == 0 and not any(self.orientation)
        return level and self.projection == "pinhole" and self.width % 8 == 0

    def keys(self) -> dict[str, Any]:
        """Of the engine's main camera."""
        return {
            "width_px": self.width,
            "height_px": self.height,
            "horizontal_fov_deg": self.hfov,
            "height_m": self.position[1],
            "max_depth_m": self.max_depth,
        }

    def further_keys(self) -> dict[str, Any]:
        """Of a further one."""
        right, up, back = self.position
        return {
            **{key: value for key, value in self.keys().items() if key != "height_m"},
            "projection": self.projection,
            "right_m": right,
            "up_m": up,
            "forward_m": -back,
            "pitch_deg": math.degrees(self.orientation[0]),
            "yaw_deg": math.degrees(self.orientation[1]),
        }


def kind_of(sensor_type: str) -> str | None:
    """The engine's sensor, such as "rgb"; None: Earshot has none of this type."""
    for prefix in ("Earshot", "HabitatSimEquirectangular", "HabitatSim"):
        for name, kind in PICTURES.items():
            if sensor_type == f"{prefix}{name}Sensor":
                return kind
    return HEARD.get(sensor_type)


def camera_of(name: str, config: Any) -> Camera:
    """Raises InputError for a picture that Earshot does not draw."""
    panorama = config.type.startswith("HabitatSimEquirectangular")
    subtype, noise = config.get("sensor_subtype", "PINHOLE"), config.get("noise_model", "None")
    if subtype != "PINHOLE":
        raise InputError(f"sensor {name}: sensor_subtype is {subtype}; use PINHOLE")
    if noise not in ("None", "none", ""):
        raise InputError(f"sensor {name}: noise_model is {noise}; use None, and habitat.simulator.earshot.observation.depth_noise")
    if any(config.orientation[2:]):
        raise InputError(f"sensor {name}: orientation is {list(config.orientation)}; a camera cannot roll: let the third angle be 0")
    return Camera(
        width=config.width,
        height=config.height,
        hfov=360.0 if panorama else float(config.get("hfov", 90)),
        projection="equirectangular" if panorama else "pinhole",
        position=tuple(config.position),
        orientation=tuple(config.orientation),
        max_depth=float(config.get("max_depth", 10.0)),
    )


def agent_of(config: Any) -> Any:
    """The config of the one agent.  Raises InputError for several."""
    if len(config.agents) != 1:
        raise InputError(f"habitat.simulator.agents has {len(config.agents)} agents; Earshot-v0 takes one")
    return next(iter(config.agents.values()))


def engine_keys(config: Any, observation: Mapping[str, Any], success_m: float | None) -> dict[str, Any]:
    """The section `env` of the engine.

    config: habitat.simulator; its keys `earshot` go over those that follow from the others.
    observation: of the sensors that are on.
    """
    check_scene_dataset(config.get("scene_dataset"), "habitat.simulator.scene_dataset")
    agent = agent_of(config)
    limit = int(config.get("max_episode_steps", 0) or 0)
    keys: dict[str, Any] = {
        "seed": int(config.seed),
        "autoreset": "off",
        "prefetch": False,
        "task": {
            "forward_m": float(config.forward_step_size),
            "turn_deg": float(config.turn_angle),
            "step_time_s": 0.25,
            "max_steps": min(limit or MAX_STEPS, MAX_STEPS),
        },
        "navmesh": {
            "agent_radius_m": float(agent.radius),
            "agent_height_m": float(agent.height),
            "max_climb_m": float(agent.max_climb),
            "max_slope_deg": float(agent.max_slope),
        },
        "observation": {"depth": False, "spectrogram": False, **observation},
    }
    if success_m is not None:
        keys["task"]["success_radius_m"] = success_m
    own = config.get("earshot") or {}
    _merge(keys, OmegaConf.to_container(own, resolve=True) if OmegaConf.is_config(own) else dict(own))
    if keys["autoreset"] != "off" or keys.get("agents", 1) != 1:
        raise InputError("habitat.simulator.earshot: autoreset and agents are given by Habitat-Lab; leave them out")
    return keys


def _merge(keys: dict[str, Any], over: Any) -> None:
    for key, value in over.items():
        if isinstance(value, Mapping) and isinstance(keys.get(key), dict):
            _merge(keys[key], value)
        else:
            keys[key] = value
