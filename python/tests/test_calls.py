# SPDX-License-Identifier: Apache-2.0
"""Wrong calls: a line that names function and argument, in any call and from any thread."""

from __future__ import annotations

import math
import re
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import earshot
from earshot.integrations._plain import PlainBatch

Make = Callable[..., dict[str, Any]]
ROOM = "shoebox:6x3x5"


def test_any_call_gives_an_error_or_a_result_and_no_signal(tmp_path: Path) -> None:
    log = tmp_path / "call"
    script = Path(__file__).parent / "fuzz_calls.py"
    done = subprocess.run([sys.executable, str(script), "300", "1", str(log)], capture_output=True, text=True, timeout=1200)
    under_way = log.read_text() if log.exists() else "none"
    assert done.returncode == 0, f"{done.returncode} in {under_way}\n{done.stderr[-3000:]}"
    assert int(done.stdout.split()[0]) >= 300


@pytest.fixture(scope="module")
def scene() -> earshot.Scene:
    return earshot.Scene(ROOM, preset="fast", settings={"rir_length_s": 0.1, "rays": 64})


def test_errors_name_function_and_argument(scene: earshot.Scene, small: Make, tmp_path: Path) -> None:
    source = scene.source([2, 1.5, 2])
    envs, env = earshot.make_vec(small(), num_envs=2), earshot.make(small())
    envs.reset(seed=1)
    env.reset(seed=1)
    listener = [4, 1.5, 2]
    cases: list[tuple[Callable[[], Any], type[Exception], str]] = [
        (lambda: earshot.Scene(ROOM, rate_hz=0), ValueError, "Scene: rate_hz is 0"),
        (lambda: earshot.Scene(ROOM, rate_hz=math.nan), ValueError, "Scene: rate_hz is nan"),
        (lambda: earshot.Scene(ROOM, seed=-1), ValueError, "Scene: seed is -1"),
        (lambda: earshot.Scene(ROOM, seed=1.5), TypeError, "Scene: seed is 1.5"),  # type: ignore[arg-type]
        (lambda: earshot.Scene(None), TypeError, "Scene: spec is None"),  # type: ignore[arg-type]
        (lambda: earshot.Scene(ROOM, settings={"rays": None}), TypeError, r"Scene: settings\['rays'\] is None"),
        (lambda: earshot.Scene(ROOM, settings="rays=4"), TypeError, "Scene: settings is 'rays=4'"),
        (lambda: scene.source([2, math.nan, 2]), ValueError, "Scene.source: position has the value nan"),
        (lambda: scene.source([2, 1.5, 2], radius_m=-1), ValueError, "Scene.source: radius_m is -1"),
        (lambda: scene.random_positions(-1), ValueError, "Scene.random_positions: count is -1"),
        (lambda: source.render(listener, None), TypeError, "Source.render: heading_deg is None"),  # type: ignore[arg-type]
        (lambda: source.render(listener, threads=-1), ValueError, "Source.render: threads is -1"),
        (lambda: source.render(listener, threads=10**9), ValueError, "Source.render: threads is 1000000000"),
        (lambda: earshot.measure(np.ones(100), 0), ValueError, "measure: sample_rate_hz is 0"),
        (lambda: earshot.measure([math.nan], 16000), ValueError, "measure: rir has the value nan"),
        (lambda: earshot.make_vec(small(), num_envs=0), ValueError, "make_vec: num_envs is 0"),
        (lambda: earshot.make_vec(small(), threads=math.nan), TypeError, "make_vec: threads is nan"),  # type: ignore[arg-type]
        (lambda: earshot.make_vec(None), TypeError, "make_vec: config is None"),
        (lambda: earshot.make(None), TypeError, "make: config is None"),
        (lambda: earshot.make(small(), threads=-1), ValueError, "make: threads is -1"),
        (lambda: earshot.make(small(), copy=1), TypeError, "make: copy is 1"),  # type: ignore[arg-type]
        (lambda: earshot.make(small(), render_mode=1), TypeError, "make: render_mode is 1"),  # type: ignore[arg-type]
        (lambda: earshot.make(small(), overrides="a=1"), TypeError, "make: overrides is 'a=1'"),
        (lambda: earshot.make(small(), first_env=-1), ValueError, "make: first_env is -1"),
        (lambda: earshot.make("absent.yaml"), ValueError, "make: config absent.yaml cannot be read"),
        (
            lambda: earshot.make_vec(small(), render_mode="ansi"),
            ValueError,
            "make_vec: render_mode is 'ansi'; give one of rgb_array, human",
        ),
        (lambda: earshot.make_vec(small(), overrides=[1]), TypeError, r"make_vec: overrides\[0\] is 1"),  # type: ignore[list-item]
        (lambda: env.reset(seed=-1), ValueError, "reset: seed is -1"),
        (lambda: env.reset(seed=1.5), TypeError, "reset: seed is 1.5"),  # type: ignore[arg-type]
        (lambda: env.reset(options=3), TypeError, "reset: options is 3"),  # type: ignore[arg-type]
        (lambda: env.step(4), ValueError, "step: action is 4"),
        (lambda: env.step(True), TypeError, "step: action is True"),
        (lambda: env.step(np.array(1.0)), TypeError, "step: action is 1.0"),
        (lambda: env.step(np.array([1])), TypeError, "step: action is of type ndarray"),
        (lambda: earshot.make_vec({"task": {"max_steps": math.nan}}), ValueError, "make_vec: config has a value that is not finite"),
        (lambda: earshot.parallel_env(small(), split=3), TypeError, "parallel_env: split is 3"),  # type: ignore[arg-type]
        (lambda: envs.reset(seed=-1), ValueError, "reset: seed is -1"),
        (lambda: envs.reset(seed=2**64), ValueError, "reset: seed is 18446744073709551616"),
        (lambda: envs.reset(seed=[1.5, 2]), TypeError, r"reset: seed\[0\] is 1.5"),  # type: ignore[list-item]
        (lambda: envs.step(np.array([2**40, 1])), ValueError, "step: actions have the value 1099511627776"),
        (lambda: envs.step(np.array([-1, 1])), ValueError, "step: actions have the value -1"),
        (lambda: envs.step(np.array([1.0, 1.0])), TypeError, "step: actions are of type float64"),
        (lambda: envs.step(np.array([True, False])), TypeError, "step: actions are of type bool"),
        (lambda: envs.batch.pose(2), ValueError, "Batch.pose: row is 2"),
        (lambda: envs.batch.restore(0, b"no state"), ValueError, "environment state"),
        (lambda: envs.batch.restore(0, "text"), TypeError, "Batch.restore: state is 'text'"),  # type: ignore[arg-type]
    ]
    for call, error, words in cases:
        with pytest.raises(error, match=words) as caught:
            call()
        assert "\n" not in str(caught.value)
        assert "command line" not in str(caught.value)


class NoArray:
    """Has a length and items, but numpy cannot read it."""

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("first line\nsecond line")

    def __len__(self) -> int:
        return 2


NO_ARRAYS: list[Any] = [
    NoArray(),
    [[1, 2], [3]],
    [1, [2]],
    [NoArray(), 1],
    [[1], 2],
    np.array([[1, 2], [3, 4], [5, 6]]),
    [10**30, "x"],
    "ab",
]


def test_what_numpy_cannot_read_is_told_in_pythons_words(scene: earshot.Scene, small: Make) -> None:
    source = scene.source([2, 1.5, 2])
    envs = earshot.make_vec(small(), num_envs=2)
    envs.reset(seed=1)
    plain = PlainBatch(small(), 2)
    plain.reset(1)
    calls: dict[str, Callable[[Any], Any]] = {
        "step: actions": envs.step,
        "step: actions of the plain batch": plain.step,
        "Batch.step: actions": envs.batch.step,
        "Batch.send: envs": lambda value: envs.batch.send(value, [1, 1]),
        "Batch.send: actions": lambda value: envs.batch.send([0, 1], value),
        "Batch.reset_masked: mask": envs.batch.reset_masked,
        "Batch.reset_masked: seeds?": lambda value: envs.batch.reset_masked([1, 1], value),
        "reset: seed": lambda value: envs.reset(seed=value),
        "reset: seed of the plain batch": plain.reset,
        "Scene.source: position": scene.source,
        "Source.render: listener": source.render,
        "measure: rir": lambda value: earshot.measure(value, 16000),
    }
    for name, call in calls.items():
        for value in NO_ARRAYS:
            if name == "measure: rir" and isinstance(value, np.ndarray):
                continue  # three channels of two samples
            with pytest.raises((ValueError, TypeError)) as caught:
                call(value)
            text = str(caught.value)
            function, argument = name.removesuffix(" of the plain batch").removesuffix("?").split(": ")
            assert text.startswith(f"{function}: ") and argument.rstrip("s") in text, f"{name}: {text}"  # noqa: PT018
            assert not re.search(r"\n|second line|inhomogeneous|sequence|truth value|broadcast|convert|cast", text), text
    envs.step([1, 1])  # type: ignore[arg-type]
    plain.step([[1], [2]])


def test_an_unknown_split_and_a_wrong_key_are_told_in_pythons_words(small: Make, tmp_path: Path) -> None:
    config = small()
    episodes = config.pop("episodes")
    calls: list[Callable[[], Any]] = [
        lambda: earshot.make_vec({"env": config, "data": {"train": episodes}}, split="x"),
        lambda: earshot.make_vec(small(task={"max_steps": -1})),
    ]
    for call in calls:
        with pytest.raises(earshot.InputError) as caught:
            call()
        assert re.search(r"\bx\b|max_steps", str(caught.value))
        assert "command line" not in str(caught.value)


def test_numbers_of_numpy_and_paths_are_arguments(scene: earshot.Scene, small: Make, tmp_path: Path) -> None:
    again = earshot.Scene(
        np.str_(ROOM),
        preset="fast",
        settings={"rir_length_s": np.float64(0.1), "rays": np.int64(64)},
        seed=np.uint64(0),  # type: ignore[arg-type]
        rate_hz=np.float32(16000),  # type: ignore[arg-type]
    )
    place = np.array([4, 1.5, 2], dtype=np.float32)
    expected = scene.source([2, 1.5, 2]).render([4, 1.5, 2], 30)
    assert np.array_equal(again.source((2, 1.5, 2)).render(place, np.float64(30), threads=np.int8(1)), expected)  # type: ignore[arg-type]
    corners = [(x, y, z) for x in (0, 5) for y in (0, 3) for z in (0, 4)]
    faces = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]
    mesh = tmp_path / "room.obj"
    mesh.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {a} {b} {c} {d}\n" for a, b, c, d in faces))
    assert earshot.Scene(mesh, preset="fast", settings={"rays": 16}).num_triangles == 12
    config = small(seed=np.int64(3), task={"max_steps": np.int32(12)})
    envs = earshot.make_vec(config, num_envs=np.int64(2), threads=np.uint8(1))  # type: ignore[arg-type]
    envs.reset(seed=np.int64(5))  # type: ignore[arg-type]
    for kind in (np.int8, np.uint64, np.int64):
        envs.step(np.array([1, 2], kind))


def test_a_batch_refuses_a_second_caller(small: Make) -> None:
    envs = earshot.make_vec(small(threads=1), num_envs=16)
    envs.reset(seed=1)
    errors: list[Exception] = []
    steps = [0]

    def walk(count: int) -> None:
        rng = np.random.default_rng(count)
        for _ in range(count):
            try:
                envs.step(rng.integers(1, 4, 16))
                steps[0] += 1
            except RuntimeError as error:
                errors.append(error)

    threads = [threading.Thread(target=walk, args=(20 + number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    walk(30)
    for thread in threads:
        thread.join(300)
    assert steps[0] > 0
    assert steps[0] + len(errors) == 30 + 20 + 21 + 22
    assert errors
    assert all(
        re.fullmatch(r"Batch\.\w+: another thread is in a call of this batch; a batch takes one caller at a time", str(e)) for e in errors
    )
    envs.step(np.ones(16, dtype=np.int32))


def test_a_place_outside_is_refused_in_every_call(scene: earshot.Scene) -> None:
    outside = [9, 1.5, 2]
    source = scene.source([2, 1.5, 2])
    for call in (
        lambda: source.render(outside),
        lambda: source.response(outside),
        lambda: source.responses([[4, 1.5, 2], outside]),
        lambda: source.plan_accuracy("t20=50%", [outside]),
        lambda: scene.source(outside).render([4, 1.5, 2]),
    ):
        with pytest.raises(earshot.InputError, match="lies outside the scene"):
            call()
