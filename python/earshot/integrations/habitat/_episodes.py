# SPDX-License-Identifier: Apache-2.0
"""Episodes of Habitat-Lab as episodes of the engine, and the sets of them that a simulator has opened."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..._engine import InputError

#: More episodes than these are opened scene by scene, in blocks of so many; an episode then has its number in its block.
MAX_OPENED = 20_000
#: Of an episode that names none, where nothing is heard.
SILENT_SOUND = "synth:telephone"

#: Onset of a sound that no step reaches.
NEVER_S = 1e6

_SCENE_SPEC = re.compile(r"[a-z_]+:")
_OPTION = re.compile(r",(?:up|unit|scene)=")  #: after the file of a scene; folders may have commas

_has_warned_of_distractors = False


def is_scene_of_earshot(scene_id: str) -> bool:
    """Whether it is a scene such as "house:7", and no path."""
    return _SCENE_SPEC.match(scene_id) is not None


def scene_of(scene_id: str, mesh: str) -> str:
    """The SCENE of an episode.  mesh: of a file, "up=z"."""
    if is_scene_of_earshot(scene_id):
        return scene_id
    return os.path.abspath(scene_id) + (f",{mesh}" if mesh and not _OPTION.search(scene_id) else "")


def check_scene_dataset(value: str | None, name: str) -> None:
    """Raises InputError for one that Earshot would leave out."""
    if value not in (None, "", "default"):
        raise InputError(f"{name} is {value}; let it be default, and name the scene as {value},scene=HANDLE")


def engine_episode(episode: Any, hears: bool = False, mesh: str = "") -> dict[str, Any]:
    """The episode in the layout of Earshot's sets.

    hears: an episode without a sound raises InputError.  mesh: as of scene_of().
    """
    check_scene_dataset(getattr(episode, "scene_dataset_config", None), f"episode {episode.episode_id!r}: scene_dataset_config")
    info = episode.info or {}
    sound = getattr(episode, "sound_id", None) or info.get("sound")
    if not sound and hears and not getattr(episode, "sources", None):
        raise InputError(f"episode {episode.episode_id!r} names no sound (info.sound), and the agent has a sensor that hears")
    positions = [_numbers(goal.position, 3, f"episode {episode.episode_id!r}: position of a goal") for goal in episode.goals]
    start = _numbers(episode.start_position, 3, f"episode {episode.episode_id!r}: start_position")
    values: dict[str, Any] = {
        "episode_id": str(episode.episode_id),
        "scene_id": scene_of(episode.scene_id, mesh),
        "start_position": start,
        "start_rotation": _numbers(episode.start_rotation, 4, f"episode {episode.episode_id!r}: start_rotation"),
        "goals": [{"position": position, "radius": goal.radius} for position, goal in zip(positions, episode.goals, strict=True)],
        "info": {
            "geodesic_distance": info.get("geodesic_distance") or max(math.dist(start, positions[0]), 1e-3),
            "num_action": max(1, int(info.get("num_action") or 1)),
            "sound": sound or SILENT_SOUND,
        },
    }
    sources = _sources(episode, positions[0], sound)
    if sources:
        values["sources"] = sources
    if getattr(episode, "noise_snr_db", None) is not None:
        values["noise_snr_db"] = episode.noise_snr_db
    return values


def _sources(episode: Any, goal: list[float], sound: str | None) -> list[dict[str, Any]] | None:
    if getattr(episode, "sources", None):
        return list(episode.sources)
    onset, duration = getattr(episode, "offset", None), getattr(episode, "duration", None)
    if getattr(episode, "distractor_sound_id", None):
        _warn_of_distractors()
    if onset is None and duration is None:
        return None
    source = {"position": goal, "sound": sound, "goal": True, "onset_s": float(onset or 0)}
    if duration is not None:
        source["duration_s"] = float(duration)
    return [source]


def _warn_of_distractors() -> None:
    global _has_warned_of_distractors
    if not _has_warned_of_distractors:
        warnings.warn("distractors of the episode set are left out: distractor_position_index names a point of a grid", stacklevel=2)
    _has_warned_of_distractors = True


def _numbers(values: Sequence[float], count: int, name: str) -> list[float]:
    numbers = [float(value) for value in values]
    if len(numbers) != count or not all(math.isfinite(value) for value in numbers):
        raise InputError(f"{name} is {list(values)}; give {count} finite numbers")
    return numbers


class EpisodeBook:
    """Numbers episodes and writes them to a set that the engine opens.

    Episodes that are known beforehand are opened together; another one opens the set again, with all that came before it in its scene.
    """

    def __init__(self, mesh: str) -> None:
        """mesh: as of scene_of()."""
        self.hears = False  #: whether episodes without a sound are refused
        self._mesh = mesh
        self._known: Sequence[Any] = ()
        self._numbers: dict[str, int] = {}
        self._made: dict[str, list[str]] = {}  #: by scene, those that were made by hand

    def know(self, episodes: Sequence[Any]) -> None:
        """episodes: of the data set."""
        self._known = episodes

    def number_of(self, episode: Any) -> int | None:
        """Index in the set that was written last; None: it is not in it."""
        return self._numbers.get(self._text(episode))

    @contextlib.contextmanager
    def written(self, episode: Any) -> Iterator[tuple[Path, int]]:
        """A set with this episode and those that are known, in their order, and its number: the bits of an episode depend on it.

        The file is there, and the episodes are in the book, until and unless the body raises; the file goes with the body.
        """
        wanted = self._text(episode)
        scene = json.loads(wanted)["scene_id"]
        texts = self._block(wanted, episode.scene_id)
        is_made_by_hand = wanted not in texts
        if is_made_by_hand:
            texts += [*self._made.get(scene, ()), wanted]  # those before it keep their numbers
        texts = list(dict.fromkeys(texts))
        numbers = {text: number for number, text in enumerate(texts)}
        with tempfile.TemporaryDirectory(prefix="earshot_habitat_") as folder:
            path = Path(folder) / "set.json"
            path.write_text('{"episodes":[' + ",\n".join(texts) + "]}", encoding="utf-8")
            yield path, numbers[wanted]
        self._numbers = numbers  # the engine has taken them
        if is_made_by_hand and wanted not in self._made.setdefault(scene, []):
            self._made[scene].append(wanted)

    def _block(self, wanted: str, scene_id: str) -> list[str]:
        """Texts of the known ones that are opened together with this one."""
        is_whole = len(self._known) <= MAX_OPENED
        texts = [self._text(other) for other in self._known if is_whole or other.scene_id == scene_id]
        first = texts.index(wanted) // MAX_OPENED * MAX_OPENED if wanted in texts else 0
        return texts[first : first + MAX_OPENED]

    def _text(self, episode: Any) -> str:
        return json.dumps(engine_episode(episode, self.hears, self._mesh))
