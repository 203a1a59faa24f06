# SPDX-License-Identifier: Apache-2.0
"""Which sequences of episodes envs play: those of several runners, and those that are given no seed.

A sequence is a seed and a number beside it, as the saved state of a batch has them; equal ones give equal episodes.
"""

from __future__ import annotations

import json
import multiprocessing
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from conftest import SMALL
from hypothesis import given
from hypothesis import strategies as st

import earshot
from earshot._seeds import spread_seeds
from earshot.integrations._plain import PlainBatch

Make = Callable[..., dict[str, Any]]
Sequences = list[tuple[int, int]]
vectors = pytest.mark.skipif(int(gymnasium.__version__.split(".")[0]) < 1, reason="gymnasium below 1.0")
PATIENCE_S = 300


def sequences(env: Any) -> Sequences:
    return [(one["seed"], one["stream"]) for one in json.loads(env.batch.save_state())["body"]["envs"]]


def all_differ(found: Sequence[tuple[int, int]]) -> bool:
    return len(set(found)) == len(found)


@given(seed=st.integers(0, 2**64 - 1), runner=st.integers(1, 2**40), envs=st.integers(1, 300), first=st.integers(0, 2**20 - 300))
def test_neighbouring_seeds_share_nothing(seed: int, runner: int, envs: int, first: int) -> None:
    own = spread_seeds(seed, envs, first)
    assert own == [(seed * 2**20 + first + env) % 2**64 for env in range(envs)]
    other = (seed + runner) % 2**64
    assert not set(own) & set(spread_seeds(other, envs, first))
    assert not set(own) & set(spread_seeds(other, envs))


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, True, None])
def test_a_wrong_seed_is_refused(seed: Any) -> None:
    with pytest.raises((earshot.InputError, TypeError), match=r"^reset: seed is "):
        spread_seeds(seed, 2)


@vectors
def test_runners_play_episodes_of_their_own(small: Make) -> None:
    from earshot.integrations._runners import RunnerEnv, RunnerVectorEnv

    batches = [RunnerVectorEnv(small(), 3) for _ in range(2)]
    singles = [[RunnerEnv(small(), runner=runner) for _ in range(2)] for runner in range(2)]

    def reset(seed: int | None) -> list[Sequences]:
        """Of all batches and of all singles, seeded as RLlib seeds a runner and gymnasium's SyncVectorEnv its envs."""
        of_batches, of_singles = [], []
        for runner in range(2):
            batches[runner].reset(seed=None if seed is None else seed + runner)
            of_batches += sequences(batches[runner])
            for number, env in enumerate(singles[runner]):
                env.reset(seed=None if seed is None else seed + runner + number)
                of_singles += sequences(env)
        return [of_batches, of_singles]

    drawn = reset(None)
    assert reset(None) == drawn  # go on
    seeded = reset(5)
    assert reset(6) != seeded
    assert reset(5) == seeded
    for found in (*drawn, *seeded):
        assert all_differ(found)
    envs = RunnerVectorEnv(small(), 2, first_env=4)
    envs.reset()
    assert sequences(envs) == [(3, 4), (3, 5)]  # the config's seed
    env = RunnerEnv(small(), runner=2)
    env.reset(seed=9)
    again = pickle.loads(pickle.dumps(env))
    again.reset(seed=9)
    assert sequences(again) == sequences(env) == [(9 * 2**20 + 2, 0)]


def test_envs_of_sample_factory_play_episodes_of_their_own(small: Make) -> None:
    found = []
    for number in range(3):  # as its workers number and seed them
        plain = PlainBatch(small(), 3, first_env=3 * number)
        plain.reset(number)
        found += sequences(plain)
    assert all_differ(found)


@vectors
def test_a_reset_without_a_seed_goes_on_in_its_sequence(small: Make) -> None:
    for env in (earshot.make(small()), earshot.parallel_env(small(agents=2))):
        env.reset()
        begun = sequences(env)
        poses = set()
        for _ in range(6):
            env.reset()
            assert sequences(env) == begun
            poses.add(env.batch.pose(0))
        assert len(poses) >= 2
        env.reset(seed=6)
        assert sequences(env) == [(6, 0)]


def begun(kind: str, **keys: Any) -> Sequences:
    config = {**SMALL, **({"agents": 2} if kind == "agents" else {})}
    env: Any = earshot.make(config, **keys) if kind == "single" else earshot.parallel_env(config, **keys)
    env.reset()
    return sequences(env)


@vectors
@pytest.mark.parametrize("kind", ["single", "agents"])
def test_envs_without_a_seed_differ(kind: str) -> None:
    assert all_differ([pair for _ in range(3) for pair in begun(kind)])
    assert begun(kind, first_env=0) == begun(kind, first_env=0) == [(3, 0)]
    assert begun(kind, first_env=7) == [(3, 7)]


@vectors
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_envs_without_a_seed_differ_in_processes(method: str) -> None:
    with multiprocessing.get_context(method).Pool(2, maxtasksperchild=1) as pool:
        found = pool.map_async(begun, ["single", "agents"], chunksize=1).get(PATIENCE_S)
    assert all_differ([pair for pairs in found for pair in pairs])


@vectors
def test_a_program_without_seeds_repeats_itself() -> None:
    code = "import test_seeds as t; print([t.begun(kind) for kind in ('single', 'agents')])"
    runs = [
        subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parent, check=True, capture_output=True, text=True).stdout
        for _ in range(2)
    ]
    assert runs[0] == runs[1]
    found = json.loads(runs[0].replace("(", "[").replace(")", "]"))
    assert found[0] == [[3, 0]]  # the first env of a program: the config's
    assert all_differ([tuple(pair) for pairs in found for pair in pairs])


@vectors
def test_a_set_that_is_played_in_order_is_played_in_order(small: Make) -> None:
    for _ in range(2):
        env = earshot.make(small(order="once"))
        env.reset()
        assert env.episode_index == 0
        assert sequences(env) == [(3, 0)]
        env.reset()
        assert env.episode_index == 1


@vectors
@pytest.mark.parametrize("vectorization", ["sync", "async"])
def test_single_envs_of_gymnasiums_batches_differ(small: Make, vectorization: str) -> None:
    name = "EarshotOfSeeds-v0"
    gymnasium.register(name, entry_point="earshot.registered:RegisteredEnv")
    keys = {"context": "spawn"} if vectorization == "async" else {}
    envs = gymnasium.make_vec(name, 3, vectorization_mode=vectorization, vector_kwargs=keys, config=small(threads=1))
    del gymnasium.registry[name]
    envs.reset()
    states = envs.call("snapshot")  # type: ignore[attr-defined]
    assert all_differ([(one["seed"], one["stream"]) for state in states for one in json.loads(state)["body"]["envs"]])
    envs.reset(seed=4)
    states = envs.call("snapshot")  # type: ignore[attr-defined]
    assert [json.loads(state)["body"]["envs"][0]["seed"] for state in states] == [4, 5, 6]
    envs.close()


def test_pufferlib_numbers_and_seeds(small: Make) -> None:
    pytest.importorskip("pufferlib", reason="no pufferlib")
    import pufferlib
    import pufferlib.vector

    from earshot.integrations.pufferlib import EarshotPufferEnv

    keys: dict[str, Any] = {"config": small(), "num_envs": 2}
    serial = pufferlib.vector.make(EarshotPufferEnv, env_kwargs=keys, backend=pufferlib.vector.Serial, num_envs=3, seed=7)
    for seed in (None, 11):
        serial.async_reset(seed)
        found = [pair for env in serial.envs for pair in sequences(env.plain)]
        assert all_differ(found)
        first = found
        serial.async_reset(None)
        assert [pair for env in serial.envs for pair in sequences(env.plain)] == first  # goes on
    # As workers of several envs are seeded: those of neighbours get the same seeds, and numbers of their own.
    found = []
    for worker in range(2):
        for number in range(2):
            env = EarshotPufferEnv(**keys, seed=2 * worker + number)
            env.reset(seed=5 + worker + number)
            found += sequences(env.plain)
    assert all_differ(found)
    with pytest.raises(earshot.InputError, match=r"^EarshotPufferEnv: seed is -1"):
        EarshotPufferEnv(**keys, seed=-1)
    with pytest.raises(TypeError, match=r"^step: actions are of type float64"):
        env.step(np.array([1.5, 2.0]))


def test_runners_of_rllib_play_episodes_of_their_own(small: Make) -> None:
    pytest.importorskip("ray.rllib", reason="no ray[rllib]")
    from ray.rllib.env.env_context import EnvContext
    from ray.tune.registry import ENV_CREATOR, _global_registry

    from earshot.integrations.rllib import register

    create = _global_registry.get(ENV_CREATOR, register("small", small()))
    singles, batches = [], []
    for worker in (None, 1, 2):
        context = EnvContext({}, worker_index=worker)
        seed = 7 + (worker or 0)  # of the runner, as RLlib gives it
        for number in range(2):
            env = create(context)
            env.reset(seed=seed + number)
            singles += sequences(env.unwrapped)
        envs = create(context | {"num_envs": 2})  # as RLlib calls it, a dict without the number of the worker
        envs.reset(seed=seed)
        batches += sequences(envs.unwrapped)
    assert all_differ(singles)
    assert all_differ(batches)


def test_adapters_spread_their_seeds(small: Make) -> None:
    pytest.importorskip("stable_baselines3", reason="no stable-baselines3")
    pytest.importorskip("torchrl", reason="no torchrl")
    from earshot.integrations.stable_baselines3 import EarshotVecEnv
    from earshot.integrations.torchrl import EarshotTorchRLEnv

    for make in (EarshotVecEnv, EarshotTorchRLEnv):
        found = []
        for seed in (5, 6):
            env: Any = make(small(), 3)
            env.seed(seed) if make is EarshotVecEnv else env.set_seed(seed)
            env.reset()
            found += sequences(env.envs)
        assert found == [(seed * 2**20 + env, 0) for seed in (5, 6) for env in range(3)]
    envs = [EarshotTorchRLEnv(small(), 2) for _ in range(3)]
    for env in envs:
        env.reset()
    assert all_differ([pair for env in envs for pair in sequences(env.envs)])
