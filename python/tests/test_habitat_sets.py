# SPDX-License-Identifier: Apache-2.0
"""Sets of episodes that habitat.Env reads and opens, good and damaged ones, and the episodes that are made by hand."""

from __future__ import annotations

import gzip
import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import earshot

if importlib.util.find_spec("habitat") is None:
    pytest.skip("no habitat-lab", allow_module_level=True)

from habitat_sets import config_of, engine, episode, l_shaped_room, own_set

from earshot.integrations import habitat as earshot_habitat

earshot_habitat.standalone()

import habitat  # noqa: E402

from earshot.integrations.habitat import _episodes, datasets  # noqa: E402
from earshot.integrations.habitat.audio_sensor import _mesh_and_keys  # noqa: E402
from earshot.integrations.habitat.datasets import AudioNavDataset  # noqa: E402


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return own_set(tmp_path_factory.mktemp("own"), engine)


def test_navigable_points_go_on_over_resets(own: Path) -> None:
    with habitat.Env(config_of(own).habitat) as env:
        env.reset()
        env.sim.seed(3)
        found = []
        for _ in range(3):
            found += [tuple(env.sim.sample_navigable_point()) for _ in range(2)]
            env.current_episode.start_position = list(found[-1])
            env.sim.reconfigure(env.sim.habitat_config, env.current_episode)  # another batch
        assert len(set(found)) == 6
        env.sim.seed(3)
        assert found == [tuple(env.sim.sample_navigable_point()) for _ in range(6)]


def test_a_refused_episode_leaves_the_later_ones_as_they_are(own: Path) -> None:
    with habitat.Env(config_of(own).habitat) as env:
        env.reset()
        good, sound = list(env.sim.get_agent_state().position), dict(env.current_episode.info)
        made = datasets.AudioGoalEpisode(**{key: getattr(env.current_episode, key) for key in datasets._EPISODE_KEYS})
        made.episode_id, made.start_position = "made", list(env.sim.sample_navigable_point())
        bad = datasets.AudioGoalEpisode(**{key: getattr(made, key) for key in datasets._EPISODE_KEYS})
        bad.info = {**sound, "sound": "no_such_sound"}
        config = env.sim.habitat_config
        with pytest.raises(earshot.InputError, match="no_such_sound"):
            env.sim.reconfigure(config, bad)
        env.sim.reconfigure(config, made)
        made.start_position = list(env.sim.sample_navigable_point())
        env.sim.reconfigure(config, made)
        assert list(env.sim.get_agent_state().position) != good


def test_sets_on_disk_go_once_they_are_open(own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with habitat.Env(config_of(own).habitat) as env:
        for _ in range(3):
            env.reset()
            env.current_episode.start_position = list(env.sim.sample_navigable_point())
            env.current_episode = env.current_episode
            assert not list(tmp_path.glob("earshot_habitat_*"))


def test_a_walk_without_a_data_set_is_silent(own: Path, tmp_path: Path) -> None:
    room = l_shaped_room(tmp_path / "room.obj")
    sim = habitat.sims.make_sim("Earshot-v0", config=config_of(own, f"habitat.simulator.scene={room}").habitat.simulator)
    heard = [sim.reset(), *(sim.step("turn_left") for _ in range(6))]
    assert not any(one["audiogoal"].any() for one in heard)
    sim.close()


def test_large_sets_are_opened_in_blocks(own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_episodes, "MAX_OPENED", 3)
    with habitat.Env(config_of(own).habitat) as env:
        book = env.sim._worlds.book
        for turn in ((6, 1, 4), (4, 6, 1)):  # the number does not depend on what came before
            for number in turn:
                with book.written(env.episodes[number]) as (path, found):
                    assert found == number % 3
                    assert len(json.loads(path.read_text())["episodes"]) <= 3


def test_measures_of_the_simulator_name_the_task_that_they_need(own: Path) -> None:
    with habitat.Env(config_of(own, "habitat.task.type=Nav-v0").habitat) as env:
        env.reset()
        env.step("move_forward")
        with pytest.raises(TypeError, match="AudioGoal-v0"):
            env.step("stop")


def test_a_data_set_of_scenes_is_refused_by_name(own: Path, tmp_path: Path) -> None:
    with pytest.raises(earshot.InputError, match=r"scene_dataset is q\.json"):
        habitat.sims.make_sim("Earshot-v0", config=config_of(own, "habitat.simulator.scene_dataset=q.json").habitat.simulator)
    path = tmp_path / "set.json"
    path.write_text(json.dumps({"episodes": [episode("0", scene_dataset_config="q.json")]}))
    with pytest.raises(earshot.InputError, match=r"q\.json,scene=HANDLE"):
        habitat.Env(config_of(path).habitat)


@pytest.mark.parametrize(
    ("scene", "mesh", "expected"),
    [
        ("/a,b/c.glb", "up=z", "/a,b/c.glb,up=z"),
        ("/a,b/c,d.glb", "up=z", "/a,b/c,d.glb,up=z"),
        ("/a/c.glb,up=y", "up=z", "/a/c.glb,up=y"),
        ("/a,b/c.glb,unit=0.01,up=y", "up=z", "/a,b/c.glb,unit=0.01,up=y"),
        ("/a/q.scene_dataset_config.json,scene=b/c", "up=z", "/a/q.scene_dataset_config.json,scene=b/c"),
        ("/a,b/c.glb", "", "/a,b/c.glb"),
        ("house:7,rooms=3", "up=z", "house:7,rooms=3"),
    ],
)
def test_options_of_meshes_follow_the_file(scene: str, mesh: str, expected: str) -> None:
    assert _episodes.scene_of(scene, mesh) == expected


def test_materials_of_a_scene_with_options() -> None:
    assert _mesh_and_keys("a,b/r.obj,unit=0.01,up=z") == ("a,b/r.obj", {"unit_m": 0.01, "up": "z"})
    assert _mesh_and_keys("q.json,scene=apt_0") == ("q.json,scene=apt_0", {})
    with pytest.raises(earshot.InputError, match="unit of the scene is 'inch'"):
        _mesh_and_keys("r.obj,unit=inch")
    sensor = earshot_habitat.AudioSensor("q.scene_dataset_config.json,scene=apt_0")
    sensor.setAudioMaterialsJSON(__file__)
    sensor.setAudioSourceTransform([0, 0, 0])
    sensor.setAudioListenerTransform([1, 0, 0], [1, 0, 0, 0])
    with pytest.raises(earshot.InputError, match="is no mesh file"):
        sensor.runSimulation()


def test_to_json_is_the_inverse_of_from_json() -> None:
    goal = {"position": [2.0, 0.0, 2.0], "radius": 0.1, "object_id": 7, "object_category": "chair", "view_points": [[1.0, 0.0, 1.0]]}
    more = {"offset": 0.5, "duration": 2.0, "sound_id": "synth:telephone", "object_category": "chair", "distractor_sound_id": "x.wav"}
    text = json.dumps({"episodes": [episode("0", goals=[goal], distractor_position_index=3, **more), episode("1")]})
    first, second = AudioNavDataset(), AudioNavDataset()
    first.from_json(text)
    first.episodes[1].start_position = np.array([1.0, 0.0, 1.0])
    second.from_json(first.to_json())
    first.episodes[1].start_position = [1.0, 0.0, 1.0]
    assert second.episodes == first.episodes
    assert second.episodes[0].goals[0].object_category == "chair"
    assert second.episodes[0].duration == 2.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"[" * 100_000, "cannot be read as an episode set"),
        (b'{"episodes":' + b"[" * 100_000, "cannot be read as an episode set"),
        (b'{"episodes": [], "content_scenes_path": "{scene}/{scene}.json.gz"}', "content_scenes_path is"),
        (b'{"episodes": [], "content_scenes_path": "{x}"}', "content_scenes_path is"),
        (b'{"episodes": [], "content_scenes_path": "{data_path}/{x}/{scene}.json"}', "content_scenes_path is"),
        (b'{"episodes": [], "content_scenes_path": 5}', "content_scenes_path is 5"),
        (b'{"episodes": [], "content_scenes_path": null}', "content_scenes_path is None"),
        (b'{"episodes": [{"episode_id": "5", "scene_id": 5, "goals": [{}]}]}', "episode '5' cannot be read"),
        (b'{"episodes": [{"episode_id": "5", "scene_id": "house:1", "goals": [5]}]}', "episode '5' cannot be read"),
        (b'{"episodes": [5]}', "episode 0 cannot be read"),
        (gzip.compress(b'{"episodes": []}' + b" " * 200_000), "has more than 150000 bytes"),
    ],
)
def test_damaged_sets_are_refused_with_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: bytes, message: str) -> None:
    monkeypatch.setattr(datasets, "MAX_BYTES", 150_000)
    path = tmp_path / "set.json.gz"
    path.write_bytes(text)
    with pytest.raises(earshot.InputError, match=message) as raised:
        AudioNavDataset(config_of(path).habitat.dataset)
    assert "\n" not in str(raised.value)


def test_files_of_other_scenes_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "content").mkdir()
    (tmp_path / "content" / "a.json.gz").write_text(json.dumps({"episodes": [episode("0", scene_id="mp3d/a/a.glb")]}))
    (tmp_path / "content" / "b.json.gz").write_text("damaged")
    path = tmp_path / "set.json"
    path.write_text('{"episodes": []}')

    def read(*overrides: str) -> Any:
        return AudioNavDataset(config_of(path, *overrides).habitat.dataset)

    assert len(read("habitat.dataset.content_scenes=[a]").episodes) == 1
    with pytest.raises(earshot.InputError, match=r"b\.json\.gz"):
        read()
