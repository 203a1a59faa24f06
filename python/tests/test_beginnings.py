# SPDX-License-Identifier: Apache-2.0
"""Which episode a reset begins, whether episodes began by a reset, a restored state or a pickle: the same in every kind of environment."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from conftest import SMALL
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import earshot
from earshot.integrations._plain import PlainBatch

Make = Callable[..., dict[str, Any]]
pytestmark = pytest.mark.skipif(int(gymnasium.__version__.split(".")[0]) < 1, reason="gymnasium below 1.0")


class Kind:
    """One kind of environment, seen alike: reset, one step, and the observations as bytes."""

    def __init__(self, name: str, **config: Any) -> None:
        config = {**SMALL, **config}
        makers: dict[str, Callable[[], Any]] = {
            "single": lambda: earshot.make(config, first_env=0),
            "vector": lambda: earshot.make_vec(config, 2, autoreset_mode="same_step", copy=True),
            "vector, off": lambda: earshot.make_vec(config, 2, autoreset_mode="disabled", copy=True),
            "agents": lambda: earshot.parallel_env({**config, "agents": 2}, first_env=0),
            "plain": lambda: PlainBatch(config, 2),
        }
        self.name = name
        self.env = makers[name]()
        self.steps = 0

    def rows(self) -> bytes:
        batch = self.env.batch
        return b"".join(batch.rows(name).tobytes() for name, *_ in batch.sensors())

    def reset(self, seed: int | None) -> bytes:
        if self.name == "plain":
            self.env.reset(seed)
        else:
            self.env.reset(seed=seed)
        self.steps = 0
        return self.rows()

    def step(self, action: int) -> bytes:
        """Of envs in an episode, which no walk without a stop ends before max_steps."""
        if self.steps == SMALL["task"]["max_steps"] - 1:
            return self.rows()
        self.steps += 1
        if self.name == "single":
            self.env.step(action)
        elif self.name == "agents":
            self.env.step(dict.fromkeys(self.env.agents, action))
        else:
            self.env.step(np.full(2, action))
        return self.rows()


KINDS = ["single", "vector", "vector, off", "agents", "plain"]
CALLS = st.lists(
    st.tuples(st.just("reset"), st.none() | st.integers(0, 2**40)) | st.tuples(st.just("step"), st.integers(1, 3)), min_size=0, max_size=5
)


@pytest.fixture(scope="module")
def pairs() -> dict[str, tuple[Kind, Kind]]:
    return {name: (Kind(name), Kind(name)) for name in KINDS}


@pytest.fixture(scope="module")
def fresh(pairs: dict[str, tuple[Kind, Kind]]) -> dict[str, bytes]:
    """States of envs that have not begun."""
    return {name: pair[0].env.batch.save_state() for name, pair in pairs.items()}


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(before=CALLS, between=CALLS, after=CALLS)
def test_a_restored_state_goes_on_as_the_env_it_is_of(
    pairs: dict[str, tuple[Kind, Kind]], fresh: dict[str, bytes], name: str, before: Any, between: Any, after: Any
) -> None:
    one, other = pairs[name]

    def run(kind: Kind, calls: Any) -> list[bytes]:
        seen = []
        for call, value in calls:
            if call == "step" and not kind.env.batch.has_started:
                continue
            seen.append(kind.reset(value) if call == "reset" else kind.step(value))
        return seen

    for kind in (one, other):  # as newly made
        kind.env.batch.restore_state(fresh[name])
        kind.steps = 0
        assert not kind.env.batch.has_started
    run(one, before)
    run(other, between)  # what it did before is forgotten
    other.env.batch.restore_state(one.env.batch.save_state())
    other.steps = one.steps
    assert other.env.batch.has_started == one.env.batch.has_started == any(call == "reset" for call, _ in before)
    calls = [*after, ("reset", None), ("step", 1), ("reset", None)]
    assert run(other, calls) == run(one, calls)


@pytest.mark.parametrize("name", KINDS)
def test_the_first_reset_begins_the_sequence_and_the_next_goes_on(pairs: dict[str, tuple[Kind, Kind]], fresh: Any, name: str) -> None:
    one, other = pairs[name]
    for kind in (one, other):
        kind.env.batch.restore_state(fresh[name])
    first, second = one.reset(None), one.reset(None)
    other.env.batch.reset()  # the engine's own way
    assert first == other.rows()
    num_envs = other.env.batch.num_envs
    other.env.batch.reset_masked(np.ones(num_envs, bool))
    assert second == other.rows() != first
    seeded = one.reset(7)
    assert other.reset(7) == seeded
    assert one.reset(None) == other.reset(None)


def test_what_needs_a_reset_takes_a_restored_state(small: Make) -> None:
    make = {"render_mode": "rgb_array", "autoreset_mode": "disabled"}
    envs, again = (earshot.make_vec(small(), 2, copy=True, **make) for _ in range(2))  # type: ignore[arg-type]
    mask = {"reset_mask": np.array([True, False])}
    with pytest.raises(RuntimeError, match="needs a reset"):
        again.render()
    with pytest.raises(ValueError, match="needs a reset of all envs first"):
        again.reset(options=mask)
    envs.reset(seed=4)
    envs.step(np.array([1, 2]))
    again.batch.restore_state(envs.batch.save_state())
    assert again.started
    frames, expected = again.render(), envs.render()
    assert frames is not None and expected is not None  # noqa: PT018
    assert all(np.array_equal(a, b) for a, b in zip(frames, expected, strict=True))
    masked, right = again.reset(options=mask)[0], envs.reset(options=mask)[0]
    assert all(np.array_equal(masked[key], right[key]) for key in right)


def test_agents_of_a_restored_state_are_those_that_walk(small: Make) -> None:
    env, again = earshot.parallel_env(small(agents=3)), earshot.parallel_env(small(agents=3))
    env.reset(seed=2)
    started = env.batch.save_state()
    env.step({"agent_0": 1, "agent_1": 0, "agent_2": 2})
    again.batch.restore_state(env.batch.save_state())
    assert again.agents == env.agents == ["agent_0", "agent_2"]
    again.batch.restore_state(started)
    assert again.agents == ["agent_0", "agent_1", "agent_2"]
    assert pickle.loads(pickle.dumps(again)).agents == again.agents
