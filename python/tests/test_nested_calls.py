# SPDX-License-Identifier: Apache-2.0
"""Calls within calls: signal handlers that call the engine or fork, and waits that a signal ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import earshot
from earshot import _engine

Make = Callable[..., dict[str, Any]]
HEADER = """
import ctypes, os, signal, sys, threading, time
import numpy as np
import earshot
from earshot import _engine
signal.signal(signal.SIGINT, signal.default_int_handler)
def room(**keys):
    return earshot.Scene("shoebox:6x3x5", preset="fast", settings={"rir_length_s": 0.1, "rays": 256, "field": "off"}, **keys)
source = room().source([2, 1.5, 2])
long_room = earshot.Scene("shoebox:9x4x7@0.3", preset="fast", settings={"rir_length_s": 0.3, "rays": 2000, "field": "off"})
long_source = long_room.source([2, 1.5, 2])  # 20 ms for a listener
place = [4, 1.5, 2]
expected = source.render(place)
def wait_for(child):
    due = time.monotonic() + 60
    while time.monotonic() < due:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "hangs"
def wait_for_a_call():
    while _engine.wait_until_idle(0):
        time.sleep(0.01)
def in_child(work):
    status = 1
    try:
        work()
        status = 0
    finally:
        os._exit(status)
def render():
    assert np.array_equal(source.render(place), expected)
    assert np.array_equal(room().source([2, 1.5, 2]).render([place] * 2, threads=2)[1], expected)
"""


def run(script: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run([sys.executable, "-c", HEADER + script], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done


def test_signal_handlers_call_the_engine_to_any_depth() -> None:
    """Each call of the nest ends with its own result, whatever the calls above it do."""
    done = run("""
DEPTH = 5
places = np.random.default_rng(1).uniform(1, 3, (12, 3))
alone = [long_source.render(places[depth:depth + 6], threads=1) for depth in range(DEPTH + 1)]
depth = deepest = 0
found = []
def nest(_number, _frame):
    global depth, deepest
    if deepest == DEPTH:
        return
    depth += 1
    deepest = max(deepest, depth)
    own = depth
    signal.setitimer(signal.ITIMER_REAL, 0.03)
    found.append((own, long_source.render(places[own:own + 6], threads=1)))
    depth -= 1
signal.signal(signal.SIGALRM, nest)
signal.setitimer(signal.ITIMER_REAL, 0.03)
found.append((0, long_source.render(places[:6], threads=1)))
for own, rirs in found:
    assert np.array_equal(rirs, alone[own]), own
print(deepest, len(found))
""")
    deepest, count = map(int, done.stdout.split())
    assert deepest >= 3, "the signals came too late: the test shows nothing"
    assert count == deepest + 1


def test_a_nested_call_that_a_signal_ends_leaves_the_others_to_go_on() -> None:
    run("""
places = np.random.default_rng(1).uniform(1, 3, (10, 3))
alone = long_source.render(places, threads=1)
class Ended(Exception): pass
ends = [False]
def handle(_number, _frame):
    if ends[0]:
        raise Ended
    ends[0] = True
    signal.setitimer(signal.ITIMER_REAL, 0.1)
    try:
        long_source.render(np.random.default_rng(2).uniform(1, 3, (400, 3)), threads=1)
    except Ended:
        ended.append(True)
ended = []
signal.signal(signal.SIGALRM, handle)
signal.setitimer(signal.ITIMER_REAL, 0.06)
assert np.array_equal(long_source.render(places, threads=1), alone)
assert ended == [True]
render()
""")


SLOW = {"preset": "high", "rir_length_s": 1.0, "rays": 600, "field": "off"}


class Ended(BaseException):
    """What the handler raises."""


@pytest.fixture
def alarm() -> Iterator[Callable[[float, Callable[[], Any]], None]]:
    before = signal.getsignal(signal.SIGALRM)

    def set_alarm(after_s: float, action: Callable[[], Any]) -> None:
        signal.signal(signal.SIGALRM, lambda _number, _frame: action())
        signal.setitimer(signal.ITIMER_REAL, after_s)

    yield set_alarm
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


def end() -> None:
    raise Ended


def test_a_batch_refuses_a_call_of_a_handler_amid_its_own(small: Make, alarm: Callable[[float, Callable[[], Any]], None]) -> None:
    envs = earshot.make_vec(small(acoustics=SLOW, threads=1), num_envs=4)
    other = earshot.make_vec(small(), num_envs=1, copy=True)
    alone = earshot.make_vec(small(), num_envs=1, copy=True)
    envs.reset(seed=1)
    other.reset(seed=1)
    alone.reset(seed=1)
    errors: list[str] = []
    stepped: list[Any] = []

    def step() -> None:
        with pytest.raises(earshot.RunError) as caught:
            envs.step(np.ones(4, np.int32))
        errors.append(str(caught.value))
        stepped.append(other.step(np.array([1])))

    alarm(0.05, step)
    envs.step(np.ones(4, np.int32))
    assert errors == ["Batch.step: a signal handler called it amid a call of this batch; a batch takes one caller at a time"]
    expected = alone.step(np.array([1]))
    for name, array in expected[0].items():
        assert np.array_equal(stepped[0][0][name], array)
    envs.step(np.ones(4, np.int32))


@pytest.mark.parametrize("as_sent", [False, True])
def test_a_recv_that_a_signal_ends_hands_nothing_to_a_later_step(
    small: Make, alarm: Callable[[float, Callable[[], Any]], None], as_sent: bool
) -> None:
    config = small(acoustics=SLOW, threads=1)
    ended, whole = earshot.make_vec(config, num_envs=3).batch, earshot.make_vec(config, num_envs=3).batch
    for batch in (ended, whole):
        batch.reset()
    actions = np.ones(3, np.int32)  # steps ahead are heard anew, a turn takes a few milliseconds
    for _ in range(2):
        ended.send([0, 1, 2], actions)
        whole.send([0, 1, 2], actions)
        alarm(0.05, end)
        with pytest.raises(Ended):
            ended.recv(3, as_sent)
        # Nothing was handed back: the envs are under way until a recv has them, and no call takes that for done.
        with pytest.raises(RuntimeError, match="already stepping"):
            ended.send([0], actions[:1])
        with pytest.raises(RuntimeError, match=r"3 environments are still stepping; call recv\(\) first"):
            ended.reset()
        assert ended.recv(3, as_sent).tolist() == whole.recv(3, as_sent).tolist() == [0, 1, 2]
        for name, *_ in whole.sensors():
            assert np.array_equal(ended.rows(name), whole.rows(name)), name
        assert ended.finished() == whole.finished()
    # One env after the other.
    for batch in (ended, whole):
        batch.send([2, 0, 1], actions)
    alarm(0.02, end)
    with pytest.raises(Ended):
        ended.recv(3, True)
    assert [ended.recv(1, True).tolist() for _ in range(3)] == [[2], [0], [1]]
    whole.recv(3, True)
    for name, *_ in whole.sensors():
        assert np.array_equal(ended.rows(name), whole.rows(name)), name


def test_a_fork_waits_for_steps_in_the_background(small: Make) -> None:
    config = small(acoustics=SLOW, threads=1)
    batch = earshot.make_vec(config, num_envs=2).batch
    batch.reset()
    begin = time.monotonic()
    batch.step(np.array([1, 1]))
    step_s = time.monotonic() - begin
    assert step_s > 0.1, "steps take too little time: the test shows nothing"
    batch.send([0, 1], [1, 1])
    child = os.fork()
    if child == 0:
        status = 1
        try:
            earshot.Scene("shoebox:6x3x5", preset="fast", settings={"rays": 64}).source([2, 1.5, 2]).render([4, 1.5, 2], threads=2)
            own = earshot.make_vec(small(), num_envs=2)
            own.reset(seed=1)
            own.step(np.array([1, 1]))
            status = 0
        finally:
            os._exit(status)
    begin = time.monotonic()
    assert batch.recv(2).tolist() == [0, 1]
    assert time.monotonic() - begin < 0.5 * step_s, "the fork did not wait for the steps"
    due = time.monotonic() + 120
    while not (found := os.waitpid(child, os.WNOHANG))[0]:
        assert time.monotonic() < due, "the child hangs"
        time.sleep(0.02)
    assert os.waitstatus_to_exitcode(found[1]) == 0
    assert _engine.wait_until_idle(60)


@pytest.mark.parametrize("fork", ["os.fork()", "ctypes.PyDLL(None).fork()"])
def test_a_child_has_a_helper_thread_of_its_own(fork: str) -> None:
    """The second fork is one of a C library, which asks none of Python's functions."""
    done = run(f"""
for _ in range(3):
    render()  # the helper of the parent is there
    child = {fork}
    if child == 0:
        def again():
            render()
            grandchild = {fork}
            if grandchild == 0:
                in_child(render)
            assert wait_for(grandchild) == 0
        in_child(again)
    print(wait_for(child))
    render()
""")
    assert done.stdout.split() == ["0"] * 3, done.stderr


def test_a_child_forked_amid_a_call_gets_one_line() -> None:
    """By a C library, which waits for no call, and by a signal handler amid the call of its own thread."""
    done = run("""
def refuse():
    for call in (render, lambda: room().plan):
        try:
            call()
        except earshot.RunError as error:
            assert "forked while another thread was computing" in str(error) and "\\n" not in str(error), error
        else:
            raise AssertionError("computed")
thread = threading.Thread(target=lambda: long_source.render([[5, 1.5, 4]] * 60, threads=1))
thread.start()
wait_for_a_call()
child = ctypes.PyDLL(None).fork()
if child == 0:
    in_child(refuse)
print(wait_for(child))
thread.join()

children = []
def fork(_number, _frame):
    children.append(ctypes.PyDLL(None).fork())
signal.signal(signal.SIGALRM, fork)
signal.setitimer(signal.ITIMER_REAL, 0.05)
try:
    rirs = long_source.render([[5, 1.5, 4]] * 12, threads=1)
except earshot.RunError as error:
    if children[0] != 0:
        raise
    if "forked by a signal handler amid a call" in str(error):
        in_child(refuse)
    os._exit(4)
assert children and children[0] != 0
print(wait_for(children[0]))
assert np.array_equal(rirs, long_source.render([[5, 1.5, 4]] * 12, threads=1))
""")
    assert done.stdout.split() == ["0", "0"], done.stderr


def test_a_handler_that_forks_amid_a_call_lets_both_go_on() -> None:
    """Python's own fork waits for the call, whose result both have."""
    done = run("""
children = []
def fork(_number, _frame):
    children.append(os.fork())
alone = long_source.render([[5, 1.5, 4]] * 10, threads=1)
signal.signal(signal.SIGALRM, fork)
signal.setitimer(signal.ITIMER_REAL, 0.05)
rirs = long_source.render([[5, 1.5, 4]] * 10, threads=1)
assert len(children) == 1, "the call was too short: the test shows nothing"
def check():
    assert np.array_equal(rirs, alone)
    render()
if children[0] == 0:
    in_child(check)
print(wait_for(children[0]))
check()
""")
    assert done.stdout.split() == ["0"], done.stderr


@pytest.mark.parametrize(
    ("waits", "text"),
    [
        ("os.fork()", "KeyboardInterrupt"),
        ("sys.exit(0)", ""),
    ],
)
def test_ctrl_c_ends_the_wait_of_a_fork_and_of_the_end(waits: str, text: str) -> None:
    """While another thread computes for a minute."""
    script = f"""
threading.Thread(target=lambda: long_source.render(np.random.default_rng(1).uniform(1, 3, (100_000, 3)), threads=1), daemon=True).start()
wait_for_a_call()
print("started", flush=True)
{waits}
"""
    process = subprocess.Popen([sys.executable, "-c", HEADER + script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    time.sleep(1)
    assert process.poll() is None, "nothing waits: the test shows nothing"
    process.send_signal(signal.SIGINT)
    begin = time.monotonic()
    process.wait(20)
    assert time.monotonic() - begin < 5
    errors = process.communicate(timeout=60)[1]
    assert process.returncode == -signal.SIGINT
    assert text in errors
    assert "Exception ignored" not in errors
