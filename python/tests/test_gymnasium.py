# SPDX-License-Identifier: Apache-2.0
"""gymnasium's own checks, and what its documentation asks of every autoreset mode.

check_env takes a gymnasium.Env alone; gymnasium has no checker of vector environments.  Does not apply: checks of np_random, which the
engine does not draw from.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import earshot

Make = Callable[..., dict[str, Any]]
MODES = ["same_step", "next_step", "disabled"]


@pytest.fixture
def registered() -> Iterator[str]:
    name = "EarshotOfTests-v0"
    gymnasium.register(name, entry_point="earshot.registered:RegisteredEnv", vector_entry_point="earshot:make_vec")
    yield name
    del gymnasium.registry[name]


def test_check_env_warns_of_open_bounds_alone(small: Make, registered: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pygame", reason="check_env opens a window")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    # With a spec check_env compares bits of resets and steps; the wrappers that make() adds are taken off again.
    env = gymnasium.make(registered, config=small(), render_mode="rgb_array").unwrapped
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env)
    env.close()
    # A distance and a spectrogram have no upper bound.
    assert [str(one.message) for one in caught if "infinity. This is probably too" not in str(one.message)] == []


def test_check_env_refuses_a_vector_environment(small: Make) -> None:
    with pytest.raises(TypeError, match=r"inherit from the gymnasium\.Env"):
        check_env(earshot.make_vec(small(), num_envs=1))  # type: ignore[arg-type]


@pytest.mark.parametrize("mode", MODES)
def test_gymnasium_makes_a_batch(small: Make, registered: str, mode: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # such as: no autoreset mode in the metadata
        envs = gymnasium.make_vec(registered, num_envs=2, vectorization_mode="vector_entry_point", config=small(), autoreset_mode=mode)
    assert isinstance(envs.unwrapped, gymnasium.vector.VectorEnv)
    assert envs.num_envs == 2
    obs, _ = envs.reset(seed=1)
    assert obs in envs.observation_space
    envs.close()


class Trace:
    """What came of a walk over several ends of episodes; where nothing resets by itself, ended envs are reset by mask."""

    def __init__(self, envs: Any, seed: Any, *, steps: int = 20) -> None:
        disabled = envs.metadata["autoreset_mode"] == gymnasium.vector.AutoresetMode.DISABLED
        rng = np.random.default_rng(5)
        self.resets = [envs.reset(seed=seed)[0]]
        self.steps: list[Any] = []
        self.ends = 0
        for _ in range(steps):
            actions = rng.choice(4, size=envs.num_envs, p=[0.1, 0.5, 0.2, 0.2])
            self.steps.append(envs.step(actions))
            ended = self.steps[-1][2] | self.steps[-1][3]
            self.ends += int(ended.sum())
            if disabled and ended.any():
                self.resets.append(envs.reset(options={"reset_mask": ended})[0])

    def __eq__(self, other: object) -> bool:
        assert isinstance(other, Trace)
        return bool(data_equivalence([self.resets, self.steps], [other.resets, other.steps], exact=True))

    __hash__ = None  # type: ignore[assignment]


@pytest.mark.parametrize("mode", MODES)
def test_a_seed_gives_the_bits_of_all_episodes_that_follow(small: Make, mode: str) -> None:
    def make() -> Any:
        return earshot.make_vec(small(), num_envs=3, autoreset_mode=mode, copy=True)

    envs = make()
    first = Trace(envs, 21)
    assert first.ends >= 4
    assert Trace(make(), 21) == first  # another batch
    assert Trace(envs, 21) == first  # the same one again, amid its episodes
    assert Trace(envs, 22) != first
    assert Trace(envs, None) != first  # goes on


@pytest.mark.parametrize("mode", MODES)
def test_a_masked_seed_begins_one_sequence_alone(small: Make, mode: str) -> None:
    envs = earshot.make_vec(small(), num_envs=2, autoreset_mode=mode, copy=True)
    first, _ = envs.reset(seed=9)
    moved, *_ = envs.step(np.array([1, 2]))
    obs, _ = envs.reset(seed=9, options={"reset_mask": np.array([False, True])})
    for key in obs:
        assert np.array_equal(obs[key][0], moved[key][0])
        assert np.array_equal(obs[key][1], first[key][1])


def test_record_episode_statistics_where_nothing_resets_by_itself(small: Make) -> None:
    envs = RecordEpisodeStatistics(earshot.make_vec(small(), num_envs=3, autoreset_mode="disabled"))
    envs.reset(seed=1)
    rng = np.random.default_rng(2)
    own_return, own_length = np.zeros(3), np.zeros(3, dtype=int)
    seen = 0
    for _ in range(30):
        _, rewards, terminated, truncated, infos = envs.step(rng.choice(4, size=3, p=[0.1, 0.5, 0.2, 0.2]))
        own_return += rewards
        own_length += 1
        ended = terminated | truncated
        assert ("episode" in infos) == bool(ended.any())
        if not ended.any():
            continue
        assert infos["_episode"].tolist() == ended.tolist() == infos["_steps"].tolist()
        assert infos["episode"]["l"].tolist() == np.where(ended, own_length, 0).tolist() == infos["steps"].tolist()
        assert np.allclose(infos["episode"]["r"], np.where(ended, own_return, 0), atol=1e-4)
        assert np.allclose(infos["episode"]["r"], infos["episode_return"], atol=1e-4)
        seen += int(ended.sum())
        envs.reset(options={"reset_mask": ended})
        own_return[ended], own_length[ended] = 0, 0
        assert envs.episode_lengths.tolist() == own_length.tolist()
    assert seen >= 5
    assert envs.episode_count == seen
    assert sum(envs.length_queue) + own_length.sum() == 30 * 3
