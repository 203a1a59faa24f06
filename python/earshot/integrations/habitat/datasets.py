# SPDX-License-Identifier: Apache-2.0
"""Episode sets in the AudioNav layout, Earshot's and the original's, as data sets of Habitat-Lab.

Files are JSON, plain or gzip, whole or split by scene (``content/SCENE.json.gz`` beside a set without episodes).
"""

from __future__ import annotations

import gzip
import json
import os
import re
import zlib
from pathlib import Path
from typing import Any

import attr
import numpy as np
from habitat.config import read_write
from habitat.core.dataset import ALL_SCENES_MASK, Dataset
from habitat.core.registry import registry
from habitat.tasks.nav.nav import NavigationEpisode, NavigationGoal

from ..._engine import InputError
from ._episodes import is_scene_of_earshot

MAX_BYTES = 2**31  #: of a file, unpacked
SCENE_PREFIX = "data/scene_datasets/"


@attr.s(auto_attribs=True, kw_only=True)
class AudioGoal(NavigationGoal):
    """A goal; those of semantic sets say which object it is."""

    object_id: Any = None
    object_name: str | None = None
    object_category: str | None = None
    room: Any = None
    view_points: list[Any] | None = None


@attr.s(auto_attribs=True, kw_only=True)
class AudioGoalEpisode(NavigationEpisode):
    """An episode with its sounds.

    sources: further keys of Earshot's sets, with ``noise_snr_db``.  The others are those of semantic sets: offset and duration are the
    onset and the duration of the sound in seconds.
    """

    sources: list[Any] | None = None
    noise_snr_db: float | None = None
    object_category: str | None = None
    sound_id: str | None = None
    offset: float | None = None
    duration: float | None = None
    distractor_sound_id: str | None = None
    distractor_position_index: int | None = None


def scene_path(scene_id: str, scenes_dir: str | None) -> str:
    """The scene as the simulator takes it: a scene of Earshot as it is, a file below scenes_dir."""
    if is_scene_of_earshot(scene_id):
        return scene_id
    name = scene_id.removeprefix(SCENE_PREFIX)
    return os.path.join(scenes_dir, name) if scenes_dir else name


def read_json(path: Path) -> dict[str, Any]:
    """Raises InputError for a file that is no set of episodes, JSON, plain or gzip, of at most MAX_BYTES."""
    try:
        with path.open("rb") as file:
            is_packed = file.peek(2)[:2] == b"\x1f\x8b"
            with gzip.open(file) if is_packed else file as plain:
                text = plain.read(MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read as an episode set ({error}); give JSON, plain or gzip") from error
    if len(text) > MAX_BYTES:
        raise InputError(f"{path}: has more than {MAX_BYTES} bytes of JSON; split it by scene (content/SCENE.json.gz)")
    return _document(str(path), text)


def _document(where: str, text: str | bytes) -> dict[str, Any]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: cannot be read as an episode set ({error}); give JSON, plain or gzip") from error
    if not isinstance(document, dict) or not isinstance(document.get("episodes"), list):
        raise InputError(f"{where}: has no list `episodes`; give a set in the AudioNav layout (docs/reference/formats.md)")
    return document


@registry.register_dataset(name="AudioNav")
class AudioNavDataset(Dataset):
    """Reads ``habitat.dataset.data_path``; ``content_scenes`` chooses scenes by the names of their files.

    Of the keys of an episode, those that it does not know are dropped.
    """

    def __init__(self, config: Any = None) -> None:
        self.episodes: list[AudioGoalEpisode] = []
        if config is None:
            return
        path = Path(config.data_path.format(split=config.split))
        for file in self._files(path, list(config.content_scenes)):
            self._read(file, config.scenes_dir)
        if not self.episodes:
            raise InputError(f"{path}: has no episodes, nor have files beside it (content/SCENE.json.gz)")
        wanted = self.build_content_scenes_filter(config)
        chosen = [episode for episode in self.episodes if wanted(episode)]
        if not chosen:
            raise InputError(f"{path}: has no episode in {list(config.content_scenes)}; the scenes are {self.scene_names()[:9]}")
        self.episodes = chosen

    @staticmethod
    def check_config_paths_exist(config: Any) -> bool:
        return os.path.exists(config.data_path.format(split=config.split))

    @classmethod
    def get_scenes_to_load(cls, config: Any) -> list[str]:
        """Names of the scenes, for ``content_scenes`` of several environments."""
        every = config.copy()
        with read_write(every):
            every.content_scenes = [ALL_SCENES_MASK]
        return cls(every).scene_names()

    def scene_names(self) -> list[str]:
        return sorted({self.scene_from_scene_path(episode.scene_id) for episode in self.episodes})

    def to_json(self) -> str:
        """What from_json() reads."""
        return json.dumps({"episodes": [_values(episode) for episode in self.episodes]}, default=_plain)

    def from_json(self, json_str: str, scenes_dir: str | None = None) -> None:
        self._add(_document("episodes", json_str), "episodes", scenes_dir)

    def _files(self, path: Path, scenes: list[str]) -> list[Path]:
        """Those of the scenes, where each has a file of its name; else all."""
        document = read_json(path)
        if document["episodes"]:
            return [path]
        pattern = document.get("content_scenes_path", "{data_path}/content/{scene}.json.gz")
        folder, _, ending = pattern.partition("{scene}") if isinstance(pattern, str) else ("{", "", "")
        if re.search("[{}\0]", folder.replace("{data_path}", "", 1) + ending) or "/" in ending:
            raise InputError(f"{path}: content_scenes_path is {pattern!r}; write {{data_path}}/content/{{scene}}.json.gz")
        beside = Path(folder.replace("{data_path}", str(path.parent)))
        named = [beside / f"{scene}{ending}" for scene in scenes]
        if named and all(file.is_file() for file in named):
            return named
        return sorted(file for file in beside.glob("*") if file.name.endswith(ending) and file.is_file())

    def _read(self, path: Path, scenes_dir: str | None) -> None:
        self._add(read_json(path), str(path), scenes_dir)

    def _add(self, document: dict[str, Any], where: str, scenes_dir: str | None) -> None:
        for number, values in enumerate(document["episodes"]):
            try:
                self.episodes.append(_episode(values, scenes_dir))
            except (AttributeError, KeyError, TypeError, ValueError) as error:
                name = values.get("episode_id", number) if isinstance(values, dict) else number
                raise InputError(f"{where}: episode {name!r} cannot be read ({error!r})") from error


_GOAL_KEYS = {field.name for field in attr.fields(AudioGoal)}
_EPISODE_KEYS = {field.name for field in attr.fields(AudioGoalEpisode) if field.init}


def _values(episode: AudioGoalEpisode) -> dict[str, Any]:
    """The inverse of _episode()."""
    values = {key: getattr(episode, key) for key in sorted(_EPISODE_KEYS)}
    values["goals"] = [{key: getattr(goal, key, None) for key in sorted(_GOAL_KEYS)} for goal in episode.goals]
    values["goals"] = [{key: value for key, value in goal.items() if value is not None} for goal in values["goals"]]
    return {key: value for key, value in values.items() if value is not None}


def _plain(value: Any) -> Any:
    """Of what JSON has not: arrays, and points of paths."""
    return attr.asdict(value) if attr.has(type(value)) else np.asarray(value).tolist()


def _episode(values: dict[str, Any], scenes_dir: str | None) -> AudioGoalEpisode:
    keys = {key: value for key, value in values.items() if key in _EPISODE_KEYS}
    goals = [AudioGoal(**{key: value for key, value in goal.items() if key in _GOAL_KEYS}) for goal in values["goals"]]
    if not goals:
        raise ValueError("goals is empty")
    keys |= {"episode_id": str(values["episode_id"]), "scene_id": scene_path(values["scene_id"], scenes_dir), "goals": goals}
    return AudioGoalEpisode(**keys)


@registry.register_dataset(name="SemanticAudioNav")
class SemanticAudioNavDataset(AudioNavDataset):
    """The same of semantic sets; an episode without sources has one at its goal, with its offset and duration."""


for _name, _class in (("AudioGoal-v0", AudioNavDataset), ("SemanticAudioGoal-v0", SemanticAudioNavDataset)):
    registry.register_dataset(_class, name=_name)
