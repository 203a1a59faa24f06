# SPDX-License-Identifier: Apache-2.0
"""Ids of gymnasium.make and gymnasium.make_vec, and the configs that the package brings."""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import earshot
from earshot.registered import make_registered_vec
from earshot.registration import ENVIRONMENTS

Make = Callable[..., dict[str, Any]]
CONFIGS = Path(earshot.__file__).parent / "configs"

# One small house in place of the set of an id, whose houses take seconds to minutes to make.
QUICK = [
    "data.{split}.file=''",
    "data.{split}.scenes=['house:1,rooms=3,area_m2=36']",
    "data.{split}.episodes_per_scene=4",
    "data.{split}.goals_per_scene=2",
    "env.acoustics.field=off",
    "env.acoustics.rir_length_s=0.2",
]


def quick(name: str) -> list[str]:
    return [text.format(split=ENVIRONMENTS[name].get("split", "train")) for text in QUICK]


def near(name: str) -> list[str]:
    """Goals within few steps."""
    return [*quick(name), *(f"data.train.filter.{key}" for key in ("min_geodesic_m=0.5", "max_geodesic_m=3", "min_ratio=1"))]


@pytest.mark.parametrize("order", ["earshot, gymnasium", "gymnasium, earshot"])
def test_imports_in_either_order_register(order: str) -> None:
    code = f"import {order}; print(*sorted(name for name in gymnasium.registry if name.startswith('earshot/')))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == sorted(earshot.env_ids())


def test_a_look_for_gymnasium_does_not_take_the_registration_away() -> None:
    code = "import earshot, importlib.util as u; u.find_spec('gymnasium')"
    code += "; import gymnasium; print('earshot/AudioGoal-v0' in gymnasium.registry)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "True"


BROKEN = {
    "earshot first": "import earshot, earshot.registration as r; r.ENVIRONMENTS['no id!'] = {}; import gymnasium",
    "gymnasium first": "import gymnasium.envs.registration as g, gymnasium; g.register = lambda *a, **k: 1 / 0; import earshot",
    "no such module": "import sys, gymnasium; sys.modules['gymnasium.envs.registration'] = None; import earshot",
}


@pytest.mark.parametrize("order", BROKEN)
def test_a_registration_that_fails_warns_and_both_imports_go_on(order: str) -> None:
    code = BROKEN[order] + "; print(gymnasium.__name__, callable(earshot.make), earshot.env_ids()[0])"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["gymnasium", "True", "earshot/AudioGoal-v0"]
    warned = [line for line in done.stderr.splitlines() if "Warning" in line]
    assert len(warned) == 1, done.stderr
    assert re.search(r"UserWarning: earshot: the ids of gymnasium\.make are not registered \(\w+: .*\); earshot\.make works$", warned[0])


def test_a_second_registration_is_silent(recwarn: pytest.WarningsRecorder) -> None:
    earshot.register_envs()
    assert [str(one.message) for one in recwarn] == []


@pytest.mark.parametrize("name", earshot.env_ids())
def test_each_id_makes_an_env_and_a_batch(name: str) -> None:
    env = gymnasium.make(name, overrides=quick(name))
    obs, _ = env.reset(seed=1)
    assert env.observation_space.contains(obs)
    obs, *_ = env.step(1)
    assert env.observation_space.contains(obs)
    envs = gymnasium.make_vec(name, num_envs=2, overrides=quick(name))
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    batch_obs, _ = envs.reset(seed=1)
    batch_obs, *_ = envs.step(np.array([1, 2]))
    assert envs.observation_space.contains(batch_obs)
    for key in obs:  # the same seed: the same bits, alone and in a batch
        assert np.array_equal(obs[key], batch_obs[key][0])
    env.close()
    envs.close()


@pytest.mark.parametrize("name", earshot.env_ids())
def test_versions_of_benchmarks_are_those_of_their_rules(name: str) -> None:
    text = (CONFIGS / f"{ENVIRONMENTS[name]['config'].removeprefix('earshot:')}.yaml").read_text()
    rules = re.search(r"^benchmark:.*?^  version: (\d+)", text, re.MULTILINE | re.DOTALL)
    assert name.endswith(f"-v{rules.group(1) if rules else 0}")


def test_rules_of_an_id_hold_beside_overrides_of_the_user() -> None:
    grid = gymnasium.make("earshot/GridAudioGoal-v0", overrides=quick("earshot/GridAudioGoal-v0")).unwrapped
    assert "motion: grid" in grid.batch.config_text  # type: ignore[attr-defined]
    lengths = gymnasium.make_vec("earshot/AudioGoal-v0", 1, overrides=quick("earshot/AudioGoal-v0"), max_episode_steps=150)
    assert "max_steps: 150" in lengths.unwrapped.batch.config_text  # type: ignore[attr-defined]


def test_observations_of_a_registered_batch_are_copies() -> None:
    name = "earshot/AudioGoal-v0"
    envs = gymnasium.make_vec(name, 1, overrides=quick(name))
    first, _ = envs.reset(seed=1)
    kept = first["depth"].copy()
    envs.step(np.array([2]))
    assert np.array_equal(first["depth"], kept)


@pytest.mark.parametrize("vectorization", ["sync", "async"])
def test_gymnasium_makes_batches_of_single_envs(vectorization: str) -> None:
    name = "earshot/AudioGoal-v0"
    keys = {"context": "spawn"} if vectorization == "async" else {}
    envs = gymnasium.make_vec(name, 2, vectorization_mode=vectorization, vector_kwargs=keys, overrides=[*quick(name), "env.threads=1"])
    own = gymnasium.make_vec(name, 2, overrides=quick(name))
    obs, _ = envs.reset(seed=4)
    expected, _ = own.reset(seed=4)
    assert all(np.array_equal(obs[key], expected[key]) for key in expected)
    for actions in np.array([[1, 2], [3, 1], [1, 1]]):
        obs, rewards, *_ = envs.step(actions)
        expected, expected_rewards, *_ = own.step(actions)
        assert all(np.array_equal(obs[key], expected[key]) for key in expected)
        assert np.allclose(rewards, expected_rewards)
    assert envs.get_attr("scene_name") == own.get_attr("scene_name")  # type: ignore[attr-defined]
    envs.close()


@pytest.mark.parametrize("vectorization", ["vector_entry_point", "sync"])
def test_max_episode_steps_truncates(small: Make, vectorization: str) -> None:
    """With a config that is an env section and with one that holds it; a limit of the task's steps, or gymnasium's TimeLimit."""
    name, limit = "earshot/GridAudioGoal-v0", 7
    envs = gymnasium.make_vec(name, 2, vectorization_mode=vectorization, max_episode_steps=limit, overrides=near(name))
    config = small()
    config["episodes"]["filter"] = {"min_geodesic_m": 0.5, "max_geodesic_m": 3, "min_ratio": 1.0}
    run = {"env": {key: value for key, value in config.items() if key != "episodes"}, "data": {"train": config["episodes"]}}
    makers: list[Any] = [envs]
    if vectorization == "vector_entry_point":
        makers += [make_registered_vec(one, 2, max_episode_steps=limit) for one in (config, run)]
    for one in makers:
        one.reset(seed=1)
        ends = [one.step(np.array([2, 3]))[2:4] for _ in range(limit)]
        assert not any(terminated.any() for terminated, _ in ends)
        assert [truncated.tolist() for _, truncated in ends] == [[False, False]] * (limit - 1) + [[True, True]]
    env = gymnasium.make(name, max_episode_steps=limit, overrides=near(name))
    env.reset(seed=1)
    assert [env.step(2)[3] for _ in range(limit)] == [False] * (limit - 1) + [True]


@pytest.mark.parametrize(
    ("limit", "error"), [(0, ValueError), (-1, ValueError), (10**7, ValueError), ("x", TypeError), (True, TypeError), (2.5, TypeError)]
)
def test_a_wrong_max_episode_steps_is_refused(small: Make, limit: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match=r"^make_vec: max_episode_steps is "):
        make_registered_vec(small(), 2, max_episode_steps=limit)


def test_specs_travel() -> None:
    name = "earshot/AudioGoal-v0"
    env = gymnasium.make(name, overrides=quick(name))
    spec = pickle.loads(pickle.dumps(env.spec))
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(spec.to_json()))
    first, _ = env.reset(seed=3)
    second, _ = again.reset(seed=3)
    assert all(np.array_equal(first[key], second[key]) for key in first)


def test_packaged_configs_are_read_by_name() -> None:
    names = earshot.packaged_configs()
    assert "earshot:train/quick" in names
    assert "earshot:benchmarks/standard" in names
    with pytest.raises(earshot.InputError, match="earshot:train/absent: the package has no such config; it has earshot:"):
        earshot.make("earshot:train/absent")
    with pytest.raises(earshot.InputError, match="no such config"):
        earshot.make("earshot:../../../../etc/passwd")


def test_the_default_mode_is_that_of_gymnasium_unless_the_config_says(small: Make, tmp_path: Path) -> None:
    assert earshot.make_vec(small()).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert earshot.make_vec(small(autoreset="same_step")).metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert earshot.make_vec(small(), overrides=["autoreset=off"]).metadata["autoreset_mode"] is AutoresetMode.DISABLED
    assert earshot.make_vec(small(autoreset="off"), autoreset_mode="same_step").metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    import json

    path = tmp_path / "env.yaml"
    path.write_text("# autoreset: off\n" + json.dumps(small())[:-1] + ", \n autoreset: same_step}  # autoreset: off\n")
    assert earshot.make_vec(path).metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
