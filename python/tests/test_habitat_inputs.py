# SPDX-License-Identifier: Apache-2.0
"""Configs, episodes and sets that habitat.Env refuses on the simulator Earshot-v0, each with one line (see test_habitat.py)."""

from __future__ import annotations

import gzip
import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest

import earshot

if importlib.util.find_spec("habitat") is None:
    pytest.skip("no habitat-lab", allow_module_level=True)

from habitat_sets import config_of, engine, episode, own_set

from earshot.integrations import habitat as earshot_habitat

earshot_habitat.standalone()

import habitat  # noqa: E402


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return own_set(tmp_path_factory.mktemp("own"), engine)


def messages() -> list[Any]:
    place = "habitat.simulator.agents.main_agent.sim_sensors.depth"
    return [
        pytest.param(
            [f"{place}.type=HabitatSimFisheyeDepthSensor"], "sensor depth: type is HabitatSimFisheyeDepthSensor .*has not", id="type"
        ),
        pytest.param(
            [f"{place}.type=Smell"], r"type is Smell \(unknown to it too\), which Earshot-v0 has not; it has Earshot", id="sensor"
        ),
        pytest.param([f"{place}.sensor_subtype=ORTHOGRAPHIC"], "sensor depth: sensor_subtype is ORTHOGRAPHIC; use PINHOLE", id="subtype"),
        pytest.param([f"{place}.orientation=[0,0,1]"], "a camera cannot roll", id="roll"),
        pytest.param(["+habitat.simulator.earshot.acoustics.reys=5"], "reys", id="key"),
        pytest.param(["+habitat.simulator.earshot.agents=2"], "leave them out", id="agents"),
        pytest.param(["habitat.simulator.turn_angle=7"], "turn_deg", id="turn"),
        pytest.param(["habitat.dataset.content_scenes=[nowhere]"], r"has no episode in \['nowhere'\]", id="scenes"),
    ]


@pytest.mark.parametrize(("overrides", "message"), messages())
def test_a_wrong_config_is_refused_with_one_line(own: Path, overrides: list[str], message: str) -> None:
    with pytest.raises(earshot.InputError, match=message) as raised:
        habitat.Env(config_of(own, *overrides).habitat)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"scene_id": "mp3d/none/none.glb"}, r"none\.glb"),
        ({"start_position": [1000.0, 0.0, 0.0]}, "start is off the walkable surface"),
        ({"sound": "no_such_sound"}, "no_such_sound"),
    ],
)
def test_a_wrong_episode_is_refused_with_one_line(tmp_path: Path, keys: dict[str, Any], message: str) -> None:
    path = tmp_path / "set.json"
    path.write_text(json.dumps({"episodes": [episode("0", **keys)]}))
    with habitat.Env(config_of(path).habitat) as env:
        with pytest.raises(earshot.InputError, match=message) as raised:
            env.reset()
        assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"no json", "cannot be read as an episode set"),
        (gzip.compress(b'{"episodes": []}')[:-9], "cannot be read as an episode set"),
        (b"[]", "has no list `episodes`"),
        (b'{"episodes": []}', "has no episodes"),
        (b'{"episodes": [{"episode_id": "5", "scene_id": "house:1"}]}', "episode '5' cannot be read"),
    ],
)
def test_a_wrong_set_is_refused_with_one_line(tmp_path: Path, text: bytes, message: str) -> None:
    path = tmp_path / "set.json.gz"
    path.write_bytes(text)
    with pytest.raises(earshot.InputError, match=message) as raised:
        habitat.Env(config_of(path).habitat)
    assert "\n" not in str(raised.value)
