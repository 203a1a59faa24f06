# SPDX-License-Identifier: Apache-2.0
"""Calls every public function with wrong, odd and right arguments: ValueError, TypeError or a right result, never a signal.

python fuzz_calls.py CALLS SEED LOG: LOG names the call under way, for whoever finds the process gone.  Prints the calls by outcome.
"""

from __future__ import annotations

import collections
import contextlib
import datetime
import math
import os
import pickle
import re
import sys
import tempfile
import warnings
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from conftest import SMALL
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as seeded
from hypothesis import strategies as st

import earshot
from earshot.integrations._plain import PlainBatch
from earshot.registered import make_registered_vec

ROOM = "shoebox:6x3x5"
FAST = {"rir_length_s": 0.05, "rays": 64}
CALLS_PER_EXAMPLE = 20
#: Words of numpy and of the interpreter, which say nothing of the function and its argument.
RAW = (
    r"array element|inhomogeneous|truth value|broadcast|could not convert|cannot be interpreted|invalid literal for|object of type|"
    r"not supported between|[Cc]annot cast|ufunc|object is not|has no attribute|has no len|must be real number|int too|unhashable|"
    r"is not iterable|unsupported operand|only .* arrays can be"
)

ODD: list[Any] = [
    *(None, True, False, 0, 1, -1, 3, 2**31, 2**32, 2**40, 2**63, 2**64, -(2**63), 10**400),
    *(0.0, 0.5, -0.0, -1.5, 1e-320, 1e38, 1e300, math.nan, math.inf, -math.inf, 1j, Fraction(1, 3)),
    *("", "x", "nan", "0", "\0", "a\0b", "\ud800", "é" * 3, "x" * 5000, "a=b", "a\nb", "{", "../..", "/", "%s%n"),
    *(b"", b"\xff\0", bytearray(b"x"), [], [None], [1, 2, 3], [[1, 2, 3], [4]], [[]], (), {}, {"a": 1}, {1: 2}, set(), [[[1.0]]]),
    *(object(), object, len, Path("absent"), Path("/"), range(3), slice(2), datetime.date(2020, 1, 1), np.array(None), Ellipsis),
    *(np.int8(1), np.uint64(2**64 - 1), np.float16(1), np.float32("nan"), np.bool_(True), np.str_("x"), np.complex64(1)),
    *(np.zeros(0), np.zeros((0, 3)), np.ones(3), np.ones((2, 3)), np.full((1, 3), np.nan), np.full((1, 3), 1e300), np.ones((3, 1, 3))),
    *(
        np.array(["a"]),
        np.array([1, None]),
        np.zeros(3, bool),
        np.ones(3, complex),
        np.array(5),
        np.ones((2, 3))[:, ::-1],
        np.ones((3, 2)).T,
    ),
    *(np.zeros(2, "M8[s]"), np.zeros(2, dtype=[("a", "i4")]), np.array([1, 1], np.int64), np.array([2**40, 1]), np.array([1.0, 2.0])),
]
odd = st.sampled_from(ODD) | st.integers() | st.floats() | st.text(max_size=8) | st.lists(st.floats() | st.integers(), max_size=4)
inside = st.tuples(st.floats(0.3, 5.7), st.floats(0.3, 2.7), st.floats(0.3, 4.7)).map(list)
places = inside | st.lists(inside, min_size=1, max_size=3)
angles = st.floats(-720, 720)
channels = st.sampled_from(["mono", "binaural", "ambisonic:1", "mono:cardioid", "quad", "surround_5_1", "stereo:ab"])
seeds = st.integers(0, 2**64 - 1)
threads = st.integers(0, 3)
acts = st.lists(st.integers(0, 3), min_size=2, max_size=2) | st.just(np.array([1, 2], np.uint8))


class Things:
    """What is called; made once."""

    def __init__(self) -> None:
        self.scene = earshot.Scene(ROOM, preset="fast", settings=FAST)
        self.source = self.scene.source([2, 1.5, 2])
        self.response = self.source.response([4, 1.5, 2])
        self.envs = earshot.make_vec(SMALL, num_envs=2, autoreset_mode="next_step")
        self.envs.reset(seed=1)
        self.batch = self.envs.batch
        self.env = earshot.make(SMALL)
        self.env.reset(seed=1)
        self.snapshot = self.batch.snapshot(0)
        self.state = self.batch.save_state()
        self.plain = PlainBatch(SMALL, 2)
        self.plain.reset(1)
        self.pair = earshot.parallel_env({**SMALL, "agents": 2})
        self.pair.reset(seed=1)
        self.policy = earshot.Policy.load("earshot:policies/quick")
        self.closed = earshot.make_vec(SMALL, num_envs=1)
        self.closed.close()


def finite(rir: Any) -> None:
    assert rir.dtype == np.float32
    assert np.isfinite(rir).all()


Call = tuple[str, Callable[..., Any], dict[str, st.SearchStrategy[Any]]]


def scene_calls(on: Things) -> list[Call]:
    """Name, function, and right values of its arguments.  Results that are wrong raise AssertionError."""

    def scene(**arguments: Any) -> None:
        made = earshot.Scene(arguments.pop("spec"), **arguments)
        assert made.num_triangles > 0
        assert repr(made)

    def source(**arguments: Any) -> None:
        finite(on.scene.source(**arguments).render([3, 1.2, 3], channels="mono"))

    def positions(**arguments: Any) -> None:
        found = on.scene.random_positions(**arguments)
        assert found.shape == (arguments["count"], 3)

    return [
        (
            "Scene",
            scene,
            {
                "spec": st.just(ROOM) | st.just("shoebox:3x3x3@0.5"),
                "preset": st.sampled_from(["fast", "balanced"]),
                "settings": st.just({"rir_length_s": 0.05}) | st.just(["rays=16"]) | st.just({"rays": np.int64(16), "diffraction": False}),
                "rate_hz": st.floats(8000, 48000),
                "seed": seeds,
                "unit_m": st.none(),
                "simplify_m": st.none(),
                "up": st.none(),
                "cell_m": st.none(),
            },
        ),
        ("Scene.random_positions", positions, {"count": st.integers(0, 5), "height_m": st.floats(0.5, 2), "seed": seeds}),
        ("Scene.section", on.scene.section, {"height_m": st.floats(-5, 5)}),
        (
            "Scene.source",
            source,
            {
                "position": inside,
                "pattern": st.sampled_from(["omni", "voice", "dipole"]),
                "heading_deg": angles,
                "pitch_deg": angles,
                "radius_m": st.floats(0, 0.2),
            },
        ),
    ]


def response_calls(on: Things) -> list[Call]:
    def render(**arguments: Any) -> None:
        finite(on.source.render(**arguments))

    def responses(**arguments: Any) -> None:
        for one in on.source.responses(**arguments):
            assert one.metrics.t20_s.shape == on.scene.bands_hz.shape

    return [
        (
            "Source.render",
            render,
            {
                "listener": places,
                "heading_deg": angles,
                "pitch_deg": angles,
                "roll_deg": angles,
                "channels": channels,
                "hrtf": st.just(""),
                "threads": threads,
            },
        ),
        ("Source.response", lambda **a: on.source.response(**a).metrics, {"listener": inside, "channels": channels}),
        ("Source.responses", responses, {"listeners": st.lists(inside, max_size=3), "channels": channels, "threads": threads}),
        (
            "Source.plan_accuracy",
            on.source.plan_accuracy,
            {"target": st.just("t20=1e9%"), "listeners": st.just([[np.nan] * 3]), "responses": st.integers(1, 9)},
        ),
        (
            "Response.render",
            lambda **a: finite(on.response.render(**a)),
            {"heading_deg": angles, "pitch_deg": angles, "roll_deg": angles, "channels": st.none() | channels, "hrtf": st.just("")},
        ),
        (
            "measure",
            earshot.measure,
            {
                "rir": st.just(np.random.default_rng(1).standard_normal((2, 400))) | st.just([1.0] * 50),
                "sample_rate_hz": st.floats(1000, 48000),
                "direct_delay_s": st.floats(0, 1),
            },
        ),
        ("pickle", lambda: pickle.loads(pickle.dumps((on.scene, on.source, on.response))), {}),
        ("html", lambda: [thing._repr_html_() for thing in (on.scene, on.source, on.response, on.response.metrics)], {}),
    ]


def env_calls(on: Things) -> list[Call]:
    def step(envs: Any, **arguments: Any) -> None:
        obs, rewards, *_ = envs.step(**arguments)
        assert np.isfinite(rewards).all()
        assert envs.observation_space.contains(obs)

    def reset(envs: Any, **arguments: Any) -> None:
        obs, _ = envs.reset(**arguments)
        assert envs.observation_space.contains(obs)

    def make(function: Callable[..., Any], **arguments: Any) -> None:
        made = function(arguments.pop("config"), **arguments)
        made.reset(seed=1)
        made.close()

    def finished_pair(**arguments: Any) -> None:
        if not on.pair.agents:
            on.pair.reset()
        on.pair.step(**arguments)

    def single_step(**arguments: Any) -> None:
        obs, _, terminated, truncated, _ = on.env.step(**arguments)
        assert on.env.observation_space.contains(obs)
        if terminated or truncated:
            on.env.reset()

    config = st.just(SMALL)
    common = {
        "overrides": st.just([]) | st.just(["task.max_steps=5"]),
        "split": st.just("train"),
        "threads": threads,
        "copy": st.booleans(),
        "first_env": st.integers(0, 3),
    }
    steps = {"max_episode_steps": st.none() | st.integers(9, 20)}
    rendered = {"render_mode": st.sampled_from([None, "rgb_array"])}
    return [
        (
            "make_vec",
            lambda **a: make(earshot.make_vec, **a),
            {
                "config": config,
                "num_envs": st.integers(1, 2),
                "autoreset_mode": st.sampled_from(["same_step", "next_step", "disabled"]),
                **common,
                **rendered,
            },
        ),
        (
            "make_registered_vec",
            lambda **a: make(make_registered_vec, **a),
            {"config": config, "num_envs": st.integers(1, 2), **common, **steps},
        ),
        ("make", lambda **a: make(earshot.make, **a), {"config": config, **common, **rendered}),
        ("Env.step", single_step, {"action": st.integers(0, 3) | st.just(np.int8(1)) | st.just(np.array(2))}),
        ("Env.reset", lambda **a: on.env.reset(**a), {"seed": st.none() | seeds, "options": st.none() | st.just({})}),
        ("parallel_env", lambda **a: make(earshot.parallel_env, **a), {"config": config, **common}),
        ("VectorEnv.step", lambda **a: step(on.envs, **a), {"actions": acts}),
        (
            "VectorEnv.reset",
            lambda **a: reset(on.envs, **a),
            {
                "seed": st.none() | st.integers(0, 99) | st.just([1, None]),
                "options": st.none() | st.just({}) | st.just({"reset_mask": np.ones(2, bool)}),
            },
        ),
        ("closed VectorEnv.step", lambda **a: on.closed.step(**a), {"actions": acts}),
        ("closed VectorEnv.reset", lambda **a: on.closed.reset(**a), {"seed": seeds}),
        (
            "ParallelEnv.step",
            finished_pair,
            {"actions": st.fixed_dictionaries({"agent_0": st.integers(1, 3), "agent_1": st.integers(1, 3)})},
        ),
        ("ParallelEnv.reset", lambda **a: on.pair.reset(**a), {"seed": st.none() | seeds, "options": st.none()}),
        ("PlainBatch.step", lambda **a: on.plain.step(**a), {"actions": acts}),
        ("PlainBatch.reset", lambda **a: on.plain.reset(**a), {"seed": st.none() | seeds}),
        ("VectorEnv.set_attr", on.envs.set_attr, {"name": st.just("mark"), "values": st.just([1, 2]) | st.just(3)}),
        ("VectorEnv.get_attr", on.envs.get_attr, {"name": st.sampled_from(["pose", "scene_name", "episode_index"])}),
        ("Env.snapshot and restore", lambda **a: on.env.restore(**a), {"state": st.builds(on.env.snapshot)}),
        ("ParallelEnv.action_space", on.pair.action_space, {"agent": st.just("agent_0")}),
        ("ParallelEnv.observation_space", on.pair.observation_space, {"agent": st.just("agent_1")}),
    ]


def batch_calls(on: Things) -> list[Call]:
    batch = on.batch
    row, env = st.integers(0, 1), st.integers(0, 1)
    return [
        ("Batch.step", batch.step, {"actions": acts}),
        ("Batch.reset_masked", batch.reset_masked, {"mask": st.just(np.ones(2, np.uint8)), "seeds": st.just([]) | st.just([1, 2])}),
        ("Batch.send", batch.send, {"envs": st.just([0, 1]) | st.just([1]), "actions": acts | st.just([1])}),
        ("Batch.recv", batch.recv, {"min_ready": st.integers(1, 2), "as_sent": st.booleans()}),
        ("Batch.rows", batch.rows, {"sensor": st.just("depth")}),
        ("Batch.final_rows", batch.final_rows, {"sensor": st.just("rgb")}),
        ("Batch.pose", batch.pose, {"row": row}),
        ("Batch.scene_name", batch.scene_name, {"row": row}),
        ("Batch.episode_index", batch.episode_index, {"row": row}),
        ("Batch.snapshot", batch.snapshot, {"env": env}),
        ("Batch.restore", batch.restore, {"env": env, "state": st.just(on.snapshot) | cut(on.snapshot)}),
        ("Batch.restore_state", batch.restore_state, {"state": st.just(on.state) | cut(on.state)}),
    ]


def policy_calls(on: Things) -> list[Call]:
    agent = on.policy
    dtypes = {"collision": np.uint8, "previous_action": np.int32}
    rows = {name: np.zeros((2, *shape), dtypes.get(name, np.float32)) for name, shape in agent.observation_shapes.items()}

    def mostly(array: Any) -> st.SearchStrategy[Any]:
        """The array, or something odd in one call of eight."""
        right = st.just(array)
        return st.integers(0, 7).flatmap(lambda draw: odd if draw == 0 else right)

    observations = st.fixed_dictionaries({name: mostly(array) for name, array in rows.items()})

    def step(**arguments: Any) -> None:
        logits, values, state = agent.step(**arguments)
        for array in (logits, values, state):
            assert np.isfinite(array).all()

    def act(**arguments: Any) -> None:
        actions = agent.act(**arguments)
        assert actions.shape == (2,)
        assert set(actions.tolist()) <= {0, 1, 2, 3}

    return [
        (
            "Policy.step",
            step,
            {"observations": observations, "state": st.just(np.zeros((2, 128), np.float32)) | st.just([[0.0] * 128] * 2)},
        ),
        (
            "Policy.act",
            act,
            {
                "observations": observations,
                "begins": st.none() | st.just([True, False]),
                "sample": st.booleans(),
                "rng": st.none() | st.just(np.random.default_rng(1)),
            },
        ),
        ("Policy.initial_state", agent.initial_state, {"num_envs": st.integers(1, 9)}),
    ]


def cut(state: bytes) -> st.SearchStrategy[bytes]:
    """A state with a byte changed and the rest cut."""
    return st.tuples(st.integers(0, len(state) - 1), st.integers(0, 255), st.integers(0, len(state))).map(
        lambda at: (state[: at[0]] + bytes([at[1]]) + state[at[0] + 1 :])[: at[2]]
    )


def judge(name: str, arguments: dict[str, Any], error: Exception) -> None:
    """Raises AssertionError for an error that is none of those that a caller may expect."""
    text = str(error)
    # A call out of turn, such as recv without send.
    out_of_turn = isinstance(error, RuntimeError) and (name.startswith("Batch.") or "closed" in text or "env" in text.lower())
    assert isinstance(error, (ValueError, TypeError)) or out_of_turn, f"{name}: {type(error).__name__}: {text}"
    if "positional argument" in text or "unexpected keyword" in text:
        return
    for wrong in ("\n", "incompatible function arguments", "nanobind", "command line", "_engine."):
        assert wrong not in text, f"{name}({list(arguments)}): {text}"
    assert not re.search(RAW, text), f"{name}({list(arguments)}): {text}"
    assert 0 < len(text) < 4200, name


def main(count: int, seed: int, log: Path) -> None:
    on = Things()
    known = scene_calls(on) + response_calls(on) + env_calls(on) + batch_calls(on) + policy_calls(on)
    outcomes: collections.Counter[str] = collections.Counter()
    by_name: collections.Counter[str] = collections.Counter()

    def one(data: st.DataObject) -> None:
        name, function, right = data.draw(st.sampled_from(known))
        # One argument in four is odd, so that errors of all arguments are reached.
        arguments = {key: data.draw(odd if data.draw(st.integers(0, 3)) == 0 else value) for key, value in right.items()}
        log.write_text(f"{name} { ({key: ascii(value)[:200] for key, value in arguments.items()}) }")
        by_name[name] += 1
        try:
            function(**arguments)
            outcomes["results"] += 1
        except AssertionError:
            raise
        except Exception as error:
            judge(name, arguments, error)
            outcomes[type(error).__name__] += 1
        if name == "Batch.send":
            with contextlib.suppress(RuntimeError, ValueError):
                on.batch.recv(1)
                on.batch.recv(1)

    @seeded(seed)
    @settings(
        max_examples=math.ceil(count / CALLS_PER_EXAMPLE),
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def all_calls(data: st.DataObject) -> None:
        for _ in range(CALLS_PER_EXAMPLE):
            one(data)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        all_calls()
    missing = {name for name, *_ in known} - set(by_name)
    print(sum(by_name.values()), dict(outcomes), f"not called: {sorted(missing)}")


if __name__ == "__main__":
    os.chdir(tempfile.mkdtemp())
    main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
