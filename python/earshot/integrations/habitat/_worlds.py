# SPDX-License-Identifier: Apache-2.0
"""The engine's batches of a simulator: which sensors they have, and which episodes they have opened."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from gym import spaces
from habitat.core.registry import registry
from habitat.tasks.nav.nav import NavigationGoal

from ..._configs import config_text
from ..._engine import InputError
from ..._engine_batch import Batch
from ._engine_config import HEARD, PICTURES, TRIAL_EPISODE, Camera, agent_of, camera_of, engine_keys, kind_of
from ._episodes import NEVER_S, SILENT_SOUND, EpisodeBook, scene_of
from .datasets import AudioGoalEpisode

ABOVE_FLOOR_M = 0.1  #: at which places are asked for: there must be some height
Wanted = tuple[str, str, str, Any]  #: name, kind, array of the engine, config


class Worlds:
    """Opens batches for a simulator config.  A batch goes on for all of its episodes, with the scenes that it has loaded."""

    def __init__(self, config: Any) -> None:
        self.config = config
        self.success_m: float | None = None
        self._cameras: list[Camera] = []
        self._observation: dict[str, Any] = {}
        self._wanted = self._read_sensors()
        self.book = EpisodeBook(config.get("mesh", "") or "")
        self._batch: Batch | None = None
        self._opened_with = ""
        self._table: dict[str, spaces.Box] = {}

    @property
    def max_steps(self) -> int:
        """Of an episode."""
        steps: int = self._keys()["task"]["max_steps"]
        return steps

    def wanted(self) -> list[Wanted]:
        """The sensors of the config, with the arrays of the engine that they read."""
        return self._wanted

    def turn_on(self, array: str) -> None:
        self._observation[array] = True

    def table(self) -> dict[str, spaces.Box]:
        """Spaces of the engine's arrays, without an episode.  Raises InputError for a key that the engine refuses."""
        if set(self._table) >= {array for array, is_on in self._observation.items() if is_on is True} and self._table:
            return self._table
        trial = {**self._keys(), "episodes": TRIAL_EPISODE, "scene_store": "", "field_store": ""}
        batch = _batch(trial, 1)
        self._table = {name: _box(dtype, shape, low, high) for name, dtype, shape, _, low, high, _ in batch.sensors()}
        return self._table

    def number_of(self, episode: Any) -> int | None:
        """In the batch that was opened last; None: another one must be opened."""
        self.book.hears = any(self._observation.get(array) for array in HEARD.values())
        number = self.book.number_of(episode)
        return None if self._batch is None or self._opened_with != repr(self._keys()) else number

    def open(self, episode: Any) -> tuple[Batch, int]:
        """A new batch with this episode, and its number there.  The one before goes first, where no caller holds it."""
        keys = self._keys()
        self._batch = None
        with self.book.written(episode) as (path, number):
            self._batch = _batch({**keys, "episodes": {"file": str(path)}}, 2)
        self._opened_with = repr(keys)
        return self._batch, number

    def walk(self, config: Any) -> AudioGoalEpisode:
        """An episode without a sound in config.scene: from the start of the config where it has one, else between any two places."""
        from ...acoustics import Scene

        agent = agent_of(config)
        scene = Scene(scene_of(config.scene, config.get("mesh", "") or ""))
        ends = scene.random_positions(2, height_m=ABOVE_FLOOR_M, seed=int(config.seed)) - (0, ABOVE_FLOOR_M, 0)
        has_start = agent.is_set_start_state
        return AudioGoalEpisode(
            episode_id="walk",
            scene_id=config.scene,
            start_position=list(agent.start_position) if has_start else ends[0].tolist(),
            start_rotation=list(agent.start_rotation) if has_start else [0.0, 0.0, 0.0, 1.0],
            goals=[NavigationGoal(position=ends[1].tolist(), radius=0.2)],
            info={"sound": SILENT_SOUND},
            offset=NEVER_S,
        )

    def close(self) -> None:
        self._batch = None

    def _keys(self) -> dict[str, Any]:
        return engine_keys(self.config, self._observation, self.success_m)

    def _read_sensors(self) -> list[Wanted]:
        configs = dict(agent_of(self.config).sim_sensors.items())
        kinds = {name: self._kind(name, config) for name, config in configs.items()}
        wanted = {}
        for name in sorted(configs, key=lambda name: kinds[name] != "depth"):  # whose range of depth a camera of colours may share
            kind = kinds[name]
            array = self._camera(name, kind, configs[name]) if kind in PICTURES.values() else kind
            if array == kind:
                self._observation[array] = True
            wanted[name] = (name, kind, array, configs[name])
        return [wanted[name] for name in configs]

    def _kind(self, name: str, config: Any) -> str:
        kind = kind_of(config.type)
        if kind is None:
            known = "of the registry of habitat" if registry.get_sensor(config.type) else "unknown to it too"
            raise InputError(
                f"sensor {name}: type is {config.type} ({known}), which Earshot-v0 has not; it has EarshotRGBSensor, EarshotDepthSensor, "
                "EarshotSemanticSensor, EarshotAudioGoalSensor, EarshotSpectrogramSensor"
            )
        return kind

    def _camera(self, name: str, kind: str, config: Any) -> str:
        """The engine's array of a picture."""
        camera = camera_of(name, config)
        if kind != "depth":
            camera = next((other for other in self._cameras if _same_place(other, camera)), camera)
        if camera not in self._cameras:
            self._cameras.append(camera)
        number = self._cameras.index(camera)
        main = next((place for place, other in enumerate(self._cameras) if other.is_main()), None)
        if number == main:
            self._observation["camera"] = camera.keys()
            return kind
        keys = self._observation.setdefault("cameras", {}).setdefault(f"camera{number}", camera.further_keys())
        keys[kind] = True
        return f"camera{number}_{kind}"


def _same_place(one: Camera, other: Camera) -> bool:
    names = ("width", "height", "hfov", "projection", "position", "orientation")
    return all(getattr(one, name) == getattr(other, name) for name in names)


def _batch(keys: dict[str, Any], num_envs: int) -> Batch:
    text, _ = config_text(keys, "Earshot-v0")
    try:
        return Batch(text, "habitat.simulator.earshot", [], [], "train", num_envs, 0)
    except InputError as error:
        raise InputError(re.sub(r"^config: ", "", str(error))) from None


def _box(dtype: str, shape: list[int], low: float, high: float) -> spaces.Box:
    kind: Any = np.dtype(dtype)
    if kind.kind != "f":
        limits = np.iinfo(kind)
        low, high = max(low, limits.min), min(high, limits.max)
    return spaces.Box(low, high, tuple(shape), kind)
