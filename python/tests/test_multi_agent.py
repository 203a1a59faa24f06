# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

import earshot

Make = Callable[..., dict[str, Any]]


def test_parallel_api(small: Make) -> None:
    parallel_api_test(earshot.parallel_env(small(agents=3)), num_cycles=60)


def test_parallel_seeds(small: Make) -> None:
    parallel_seed_test(lambda: earshot.parallel_env(small(agents=2)), num_cycles=30)


def test_an_agent_that_stops_leaves_the_others(small: Make) -> None:
    env = earshot.parallel_env(small(agents=3))
    obs, infos = env.reset(seed=2)
    assert list(obs) == list(infos) == env.agents == ["agent_0", "agent_1", "agent_2"]
    for agent in env.agents:
        assert env.observation_space(agent).contains(obs[agent])
    obs, rewards, terminated, truncated, _ = env.step({"agent_0": 1, "agent_1": 0, "agent_2": 2})
    assert terminated == {"agent_0": False, "agent_1": True, "agent_2": False}
    assert not any(truncated.values())
    assert env.agents == ["agent_0", "agent_2"]
    assert np.abs(obs["agent_1"]["depth"]).max() > 0  # its last observation, not the empty row of one that waits
    obs, rewards, *_ = env.step({"agent_0": 2, "agent_2": 2})
    assert set(obs) == set(rewards) == {"agent_0", "agent_2"}
    *_, infos = env.step({"agent_0": 0, "agent_2": 0})
    assert env.agents == []
    assert infos["agent_0"]["steps"] == 3
    assert infos["agent_0"]["ended"]["agent_1"]["steps"] == 1
    env.close()


def test_many_agents_are_refused_by_the_vector_environment(small: Make) -> None:
    with pytest.raises(earshot.InputError, match="parallel_env"):
        earshot.make_vec(small(agents=2), num_envs=2)


def test_an_action_is_asked_of_every_agent(small: Make) -> None:
    env = earshot.parallel_env(small(agents=2))
    env.reset(seed=1)
    with pytest.raises(earshot.InputError, match="agent_1"):
        env.step({"agent_0": 1})
