# SPDX-License-Identifier: Apache-2.0
"""Objects that travel: pickles, copies, forks, and processes that are started in each way."""

from __future__ import annotations

import copy
import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from numpy.typing import NDArray
from test_registration import quick

import earshot

Make = Callable[..., dict[str, Any]]
ROOM = "shoebox:6x3x5"
SETTINGS = {"rir_length_s": 0.1, "rays": 256}
PLACES = np.array([[4, 1.5, 2], [3, 1.2, 4], [5, 1.6, 3.5]])
PATIENCE_S = 300
METHODS = ["fork", "spawn", "forkserver"]


def room(**keys: Any) -> earshot.Scene:
    return earshot.Scene(ROOM, preset="fast", settings=SETTINGS, **keys)


def test_scenes_sources_and_responses_come_back_with_their_bits() -> None:
    source = room(seed=5).source([2, 1.5, 2], pattern="voice", heading_deg=40, radius_m=0.1)
    response = source.response(PLACES[1])
    scene, again, heard = pickle.loads(pickle.dumps((source.scene, source, response)))
    assert scene is again.scene is source.scene  # alive: it is shared
    assert np.array_equal(again.render(PLACES), source.render(PLACES))
    assert np.array_equal(heard.render(30), response.render(30))
    assert np.array_equal(heard.late, response.late)


def test_a_response_with_a_field_comes_back_with_its_bits() -> None:
    source = earshot.Scene(
        "house:1,rooms=3,area_m2=36", preset="fast", settings={**SETTINGS, "field": "on", "field_photons": 20_000}
    ).source([2, 1.5, 2])
    responses = source.responses(source.scene.random_positions(4, seed=1))
    for before, after in zip(responses, pickle.loads(pickle.dumps(responses)), strict=True):
        assert np.array_equal(before.late, after.late)
        assert np.array_equal(before.listener, after.listener)


def test_values_pickle_as_they_are() -> None:
    response = room().source([2, 1.5, 2]).response(PLACES[0])
    metrics, arrivals, plan = pickle.loads(pickle.dumps((response.metrics, response.arrivals, response.source.scene.plan)))
    assert np.array_equal(metrics.t20_s, response.metrics.t20_s, equal_nan=True)
    assert np.array_equal(arrivals.amplitude, response.arrivals.amplitude)
    assert [line.why for line in plan] == [line.why for line in response.source.scene.plan]


def write_room(path: Path, height: float) -> None:
    corners = [(x, y, z) for x in (0, 5) for y in (0, height) for z in (0, 4)]
    faces = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]
    path.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {a} {b} {c} {d}\n" for a, b, c, d in faces))


def test_a_file_is_found_from_another_folder_and_refused_once_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "other").mkdir()
    write_room(tmp_path / "room.obj", 3)
    monkeypatch.chdir(tmp_path)
    scene = earshot.Scene("room.obj", preset="fast", settings=SETTINGS)
    text, rir = pickle.dumps(scene), scene.source([1, 1.5, 1]).render([3, 1.2, 3])
    del scene
    monkeypatch.chdir(tmp_path / "other")
    assert np.array_equal(pickle.loads(text).source([1, 1.5, 1]).render([3, 1.2, 3]), rir)
    write_room(tmp_path / "room.obj", 3.5)
    with pytest.raises(earshot.InputError, match="has changed since the scene was pickled"):
        pickle.loads(text)


def test_deep_copies_work(small: Make) -> None:
    source = room().source([2, 1.5, 2])
    again, response, config = copy.deepcopy((source, source.response(PLACES[0]), small()))
    assert np.array_equal(again.render(PLACES), source.render(PLACES))
    assert np.array_equal(response.render(), source.render(PLACES[0]))
    assert np.array_equal(copy.copy(source).render(PLACES), source.render(PLACES))
    assert config == small()


def walk(envs: Any, steps: int) -> list[NDArray[Any]]:
    rng = np.random.default_rng(3)
    seen = []
    for _ in range(steps):
        obs, rewards, *_ = envs.step(rng.integers(1, 4, envs.num_envs))
        seen += [rewards, *(obs[name].copy() for name in sorted(obs))]
    return seen


@pytest.mark.parametrize("way", ["pickle", "deepcopy"])
def test_a_batch_goes_on_where_it_was(small: Make, way: str) -> None:
    envs = earshot.make_vec(small(), num_envs=2, copy=True)
    envs.reset(seed=8)
    walk(envs, 5)
    again = pickle.loads(pickle.dumps(envs)) if way == "pickle" else copy.deepcopy(envs)
    for before, after in zip(walk(envs, 15), walk(again, 15), strict=True):
        assert np.array_equal(before, after)
    fresh = pickle.loads(pickle.dumps(earshot.make_vec(small(), num_envs=2, copy=True)))
    assert np.array_equal(fresh.reset(seed=8)[0]["depth"], earshot.make_vec(small(), num_envs=2).reset(seed=8)[0]["depth"])


@pytest.mark.parametrize("way", ["pickle", "deepcopy"])
def test_an_env_goes_on_where_it_was(small: Make, way: str) -> None:
    env = earshot.make(small())
    env.reset(seed=8)
    for action in (1, 2, 1):
        env.step(action)
    again = pickle.loads(pickle.dumps(env)) if way == "pickle" else copy.deepcopy(env)
    for action in np.random.default_rng(4).integers(1, 4, 8).tolist():
        before, after = env.step(action), again.step(action)
        assert before[1:] == after[1:]
        assert before[0].keys() == after[0].keys()
        assert all(np.array_equal(before[0][name], after[0][name]) for name in before[0])
    fresh = pickle.loads(pickle.dumps(earshot.make(small())))
    assert np.array_equal(fresh.reset(seed=8)[0]["depth"], earshot.make(small()).reset(seed=8)[0]["depth"])


def test_a_render_mode_travels(small: Make) -> None:
    env, envs = earshot.make(small(), render_mode="rgb_array"), earshot.make_vec(small(), 2, render_mode="rgb_array")
    env.reset(seed=8)
    envs.reset(seed=8)
    env_again, envs_again = pickle.loads(pickle.dumps((env, envs)))
    assert env_again.render_mode == envs_again.render_mode == "rgb_array"
    assert env_again.observation_space == env.observation_space
    assert envs_again.observation_space == envs.observation_space
    env.step(1)
    env_again.step(1)
    envs.step(np.array([1, 2]))
    envs_again.step(np.array([1, 2]))
    assert np.array_equal(env_again.render(), env.render())
    frames = envs.render()
    assert frames is not None
    assert np.array_equal(envs_again.render(), frames)


def test_agents_go_on_where_they_were(small: Make) -> None:
    env = earshot.parallel_env(small(agents=2))
    env.reset(seed=8)
    env.step({"agent_0": 1, "agent_1": 0})
    again = pickle.loads(pickle.dumps(env))
    assert again.agents == env.agents == ["agent_0"]
    for _ in range(3):
        before, after = env.step({"agent_0": 2}), again.step({"agent_0": 2})
        assert before[1:4] == after[1:4]
        assert np.array_equal(before[0]["agent_0"]["depth"], after[0]["agent_0"]["depth"])


@pytest.mark.parametrize("way", ["pickle", "deepcopy"])
def test_what_others_have_set_travels(small: Make, way: str) -> None:
    env: Any = earshot.make(small())
    envs: Any = earshot.make_vec(small(), 2)
    agents: Any = earshot.parallel_env(small(agents=2))
    spec = gymnasium.envs.registration.EnvSpec("Some-v0", entry_point="earshot:make", kwargs={"split": "train"})
    env.spec = envs.spec = spec
    env.reset(seed=8)
    envs.reset(seed=8)
    agents.reset(seed=8)
    spaces = [env.action_space, env.observation_space, envs.action_space, envs.single_action_space, agents.action_space("agent_1")]
    for seed, space in enumerate(spaces):
        space.seed(seed)
        space.sample()
    env.np_random.random(3)
    envs.np_random.random(3)
    env.mark = agents.mark = {"a": [1]}
    env.metadata["render_fps"] = envs.metadata["render_fps"] = 99
    envs.set_attr("mark", [4, 5])
    again, again_envs, again_agents = (
        pickle.loads(pickle.dumps(one)) if way == "pickle" else copy.deepcopy(one) for one in (env, envs, agents)
    )
    assert again.spec == again_envs.spec == spec
    assert again.mark == again_agents.mark == {"a": [1]}
    assert again.metadata == env.metadata
    assert again_envs.metadata == envs.metadata
    assert again_envs.get_attr("mark") == (4, 5)
    assert again.np_random_seed == env.np_random_seed == 8
    assert again.np_random.random(4).tolist() == env.np_random.random(4).tolist()
    assert again_envs.np_random.random(4).tolist() == envs.np_random.random(4).tolist()
    others = [again.action_space, again.observation_space, again_envs.action_space, again_envs.single_action_space]
    others.append(again_agents.action_space("agent_1"))
    for space, other in zip(spaces, others, strict=True):
        assert all(data_equivalence(space.sample(), other.sample(), exact=True) for _ in range(3))
    again.mark["a"].append(2)
    assert env.mark == {"a": [1]}


def test_a_registered_env_travels_with_its_wrappers() -> None:
    name = "earshot/AudioGoal-v0"
    env = gymnasium.make(name, overrides=quick(name))
    env.reset(seed=8)
    again = pickle.loads(pickle.dumps(env))
    assert again.spec == env.spec
    assert type(again.unwrapped) is type(env.unwrapped)
    assert data_equivalence(again.step(1), env.step(1), exact=True)
    twin = gymnasium.make(again.spec)
    assert data_equivalence(twin.reset(seed=8)[0], env.reset(seed=8)[0], exact=True)


def render_in_child(source: earshot.Source) -> NDArray[np.float32]:
    return source.render(PLACES, threads=2)


@pytest.mark.parametrize("method", METHODS)
def test_processes_render_the_same_bits(method: str) -> None:
    source = room().source([2, 1.5, 2])
    expected = source.render(PLACES)  # thread pools of the engine run before the fork
    with multiprocessing.get_context(method).Pool(2) as pool:
        for rir in pool.map_async(render_in_child, [source] * 4).get(PATIENCE_S):
            assert np.array_equal(rir, expected)


def walk_in_child(envs: Any) -> list[NDArray[Any]]:
    return walk(envs, 4)


@pytest.mark.parametrize("method", METHODS)
def test_processes_step_the_same_bits(small: Make, method: str) -> None:
    envs = earshot.make_vec(small(), num_envs=2, copy=True)
    envs.reset(seed=8)
    with multiprocessing.get_context(method).Pool(1) as pool:
        after = pool.apply_async(walk_in_child, (envs,)).get(PATIENCE_S)
    for expected, array in zip(walk(envs, 4), after, strict=True):
        assert np.array_equal(expected, array)


def status_of_child(work: Callable[[], None]) -> int:
    """Exit code of a fork, whose deadlock is one."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            work()
            status = 0
        finally:
            os._exit(status)
    due = time.monotonic() + PATIENCE_S
    while time.monotonic() < due:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    pytest.fail("the child hangs")


def test_a_fork_amid_calls_of_other_threads_does_not_hang() -> None:
    source = room().source([2, 1.5, 2])
    expected = source.render(PLACES)
    stop = threading.Event()

    def keep_busy() -> None:
        while not stop.is_set():
            source.render(PLACES, threads=2)

    def render() -> None:
        assert np.array_equal(source.render(PLACES), expected)
        assert np.array_equal(room(seed=0).source([2, 1.5, 2]).render(PLACES, threads=3), expected)

    threads = [threading.Thread(target=keep_busy) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        assert [status_of_child(render) for _ in range(5)] == [0] * 5
    finally:
        stop.set()
        for thread in threads:
            thread.join(PATIENCE_S)


def test_a_batch_of_the_parent_is_refused_in_a_child_and_stays_with_the_parent(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=2)
    envs.reset(seed=1)

    def step() -> None:
        with pytest.raises(earshot.RunError, match="made before a fork"):
            envs.step(np.array([1, 1]))
        envs.close()  # does not wait for threads that are not there
        own = earshot.make_vec(small(), num_envs=2)
        own.reset(seed=1)
        own.step(np.array([1, 1]))
        own.close()

    assert status_of_child(step) == 0
    envs.step(np.array([1, 1]))


def test_a_torch_loader_renders() -> None:
    torch = pytest.importorskip("torch")
    source = room().source([2, 1.5, 2])
    expected = [source.render(place) for place in PLACES]

    class Rirs(torch.utils.data.Dataset):  # type: ignore[misc,name-defined]
        def __len__(self) -> int:
            return len(PLACES)

        def __getitem__(self, index: int) -> NDArray[np.float32]:
            return source.render(PLACES[index], threads=1)

    for rir, right in zip(torch.utils.data.DataLoader(Rirs(), num_workers=2, batch_size=None), expected, strict=True):
        assert np.array_equal(np.asarray(rir), right)
