# SPDX-License-Identifier: Apache-2.0
"""Signals take effect within 0.2 s in every long call, and what was called stays usable."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import earshot
from earshot import _engine

Make = Callable[..., dict[str, Any]]
LIMIT_S = 0.2
AFTER_S = 0.15
TRIES = 5


class Ended(BaseException):
    """What the handler raises."""


@pytest.fixture(autouse=True)
def handler() -> Iterator[None]:
    def end(_number: int, _frame: Any) -> None:
        raise Ended

    before = signal.signal(signal.SIGALRM, end)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)
    assert _engine.wait_until_idle(600)


def latency_s(call: Callable[[], Any]) -> float:
    """From the signal until the caller has the exception.  Skips where the call was done before."""
    due = time.monotonic() + AFTER_S
    try:
        signal.setitimer(signal.ITIMER_REAL, AFTER_S)
        call()
    except Ended:
        return time.monotonic() - due
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    pytest.skip("the call took less time than the signal")


def check(call: Callable[[], Any], record: Callable[[str, float], None], name: str) -> None:
    """The best of some tries, as a machine that is busy lets any thread wait."""
    best = np.inf
    for _ in range(TRIES):
        best = min(best, latency_s(call))
        if best <= LIMIT_S:
            break
        assert _engine.wait_until_idle(600)  # what the last try left does not make the machine busy for the next
    record(name, best)
    assert best <= LIMIT_S, name


LONG_ROOM = {"preset": "high", "settings": {"rays": 200_000, "rir_length_s": 1.0, "field": "off"}}


def test_one_response_and_many(record_property: Callable[[str, float], None]) -> None:
    source = earshot.Scene("shoebox:9x4x7@0.05", **LONG_ROOM).source([2, 1.5, 2])  # type: ignore[arg-type]
    check(lambda: source.render([5, 1.5, 4]), record_property, "render")
    places = np.random.default_rng(1).uniform(1, 3, (1000, 3))
    check(lambda: source.render(places), record_property, "render 1000")
    check(lambda: source.responses(places), record_property, "responses")


def test_a_field(record_property: Callable[[str, float], None]) -> None:
    scene = earshot.Scene("house:7", preset="high", settings={"field": "on", "field_photons": 16_777_216, "field_error": 0.001})
    places = scene.random_positions(2, seed=1)
    check(lambda: scene.source(places[0]).render(places[1]), record_property, "field")


def test_a_scene_and_its_plan(record_property: Callable[[str, float], None]) -> None:
    check(lambda: earshot.Scene("house:7,area_m2=400").plan, record_property, "scene")
    room = earshot.Scene("house:9,area_m2=100")
    check(lambda: room.random_positions(1_000_000), record_property, "random_positions")


def test_an_accuracy(record_property: Callable[[str, float], None]) -> None:
    source = earshot.Scene("house:7").source([2, 1.5, 2])
    listeners = source.scene.random_positions(8, seed=2)
    check(lambda: source.plan_accuracy("t20=1%", listeners), record_property, "plan_accuracy")


def test_make_step_and_reset_and_the_batch_goes_on(small: Make, record_property: Callable[[str, float], None]) -> None:
    acoustics = {"preset": "high", "rir_length_s": 1.5, "rays": 1_500, "field": "off"}
    config = small(acoustics=acoustics, threads=1)
    config["episodes"] = {**config["episodes"], "scenes": ["house:1..4"], "episodes_per_scene": 6}
    check(lambda: earshot.make_vec(config, num_envs=4), record_property, "make")
    config["episodes"] = {**config["episodes"], "scenes": ["house:1,rooms=3,area_m2=36"], "episodes_per_scene": 6}
    ended, whole = (earshot.make_vec(config, num_envs=2, copy=True) for _ in range(2))
    check(lambda: ended.reset(seed=4), record_property, "reset")
    actions = np.array([1, 2])
    ended.reset(seed=4)  # waits for the call that was left
    check(lambda: ended.step(actions), record_property, "step")
    obs, _ = ended.reset(seed=4)
    expected, _ = whole.reset(seed=4)
    for name, array in expected.items():
        assert np.array_equal(array, obs[name]), name


@pytest.mark.parametrize("ends", ["", "try:\n    work()\nexcept KeyboardInterrupt:\n    raise SystemExit(3)"])
def test_ctrl_c_ends_a_program(tmp_path: Path, ends: str) -> None:
    # Where the tests run in the background of a shell, children inherit a SIGINT that is ignored.
    script = f"""
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
import earshot, sys
source = earshot.Scene("shoebox:9x4x7@0.05", preset="high", settings={{"rays": 200_000, "field": "off"}}).source([2, 1.5, 2])
def work():
    print("started", flush=True)
    source.render([[5, 1.5, 4]] * 1000)
{ends or "work()"}
"""
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == (3 if ends else -signal.SIGINT)
    if not ends:
        assert errors.strip().endswith("KeyboardInterrupt")
    assert list(tmp_path.iterdir()) == []
