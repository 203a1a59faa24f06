# SPDX-License-Identifier: Apache-2.0
"""Episode sets in the AudioNav layout, Earshot's and the original's, as data sets of Habitat-Lab.

Files are JSON, plain or gzip, whole or split by scene (``content/SCENE.json.gz`` beside a set without episodes).
"""

from __future__ import annotations

import gzip
import json
import os
from pathlib import Path
from typing import Any

import attr
from habitat.config import read_write
from habitat.core.dataset import ALL_SCENES_MASK, Dataset
from habitat.core.registry import registry
from habitat.tasks.nav.nav import NavigationEpisode, NavigationGoal

from ..._engine import InputError
from ._episodes import engine_episode, is_scene_of_earshot

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
    """Raises InputError for a file that is no JSON, plain or gzip."""
    try:
        data = path.read_bytes()
        document = json.loads(gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data)
    except (OSError, EOFError, ValueError, gzip.zlib.error) as error:  # type: ignore[attr-defined]
        raise InputError(f"{path}: cannot be read as an episode set ({error}); give JSON, plain or gzip") from error
    if not isinstance(document, dict) or not isinstance(document.get("episodes"), list):
        raise InputError(f"{path}: has no list `episodes`; give a set in the AudioNav layout (docs/reference/formats.md)")
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
        for file in self._files(path):
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
        return json.dumps({"episodes": [engine_episode(episode) for episode in self.episodes]})

    def from_json(self, json_str: str, scenes_dir: str | None = None) -> None:
        self._add(json.loads(json_str), "episodes", scenes_dir)

    def _files(self, path: Path) -> list[Path]:
        document = read_json(path)
        if document["episodes"]:
            return [path]
        pattern = document.get("content_scenes_path", "{data_path}/content/{scene}.json.gz")
        folder, ending = pattern.split("{scene}") if "{scene}" in pattern else (pattern, "")
        beside = Path(folder.format(data_path=path.parent))
        return sorted(file for file in beside.glob(f"*{ending}") if file.is_file())

    def _read(self, path: Path, scenes_dir: str | None) -> None:
        self._add(read_json(path), str(path), scenes_dir)

    def _add(self, document: dict[str, Any], where: str, scenes_dir: str | None) -> None:
        for number, values in enumerate(document["episodes"]):
            try:
                self.episodes.append(_episode(values, scenes_dir))
            except (KeyError, TypeError, ValueError) as error:
                name = values.get("episode_id", number) if isinstance(values, dict) else number
                raise InputError(f"{where}: episode {name!r} cannot be read ({error!r})") from error


_GOAL_KEYS = {field.name for field in attr.fields(AudioGoal)}
_EPISODE_KEYS = {field.name for field in attr.fields(AudioGoalEpisode) if field.init}


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
