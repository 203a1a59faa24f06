# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import gc
import re
import weakref
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics
from numpy.typing import NDArray

import earshot

Make = Callable[..., dict[str, Any]]
MODES = {
    "same_step": AutoresetMode.SAME_STEP,
    "next_step": AutoresetMode.NEXT_STEP,
    "disabled": AutoresetMode.DISABLED,
}
FORWARD, STOP = 1, 0


def actions_of(steps: int, num_envs: int, seed: int = 0) -> NDArray[np.int32]:
    """Walks without a stop, which ends an episode."""
    return np.random.default_rng(seed).integers(1, 4, size=(steps, num_envs), dtype=np.int32)


def equal(a: dict[str, NDArray[Any]], b: dict[str, NDArray[Any]]) -> bool:
    return a.keys() == b.keys() and all(np.array_equal(a[key], b[key]) for key in a)


def test_spaces_hold_what_comes(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=3)
    assert isinstance(envs, gymnasium.vector.VectorEnv)
    assert envs.single_action_space == gymnasium.spaces.Discrete(4)
    assert envs.action_space == gymnasium.spaces.MultiDiscrete([4, 4, 4])
    obs, info = envs.reset(seed=1)
    assert info == {}
    assert set(obs) == {"depth", "rgb", "spectrogram", "pointgoal", "collision", "previous_action"}
    assert obs["depth"].shape == (3, 16, 16, 1)
    assert envs.observation_space.contains(obs)
    for actions in actions_of(15, 3):
        obs, rewards, terminations, truncations, _ = envs.step(actions)
        assert envs.observation_space.contains(obs)
        assert envs.single_observation_space.contains({key: array[0] for key, array in obs.items()})
        assert rewards.shape == terminations.shape == truncations.shape == (3,)
        assert [array.dtype for array in (rewards, terminations, truncations)] == [np.dtype(np.float32), np.dtype(bool), np.dtype(bool)]
    envs.close()


def test_observations_are_views_of_the_engine(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=2)
    obs, _ = envs.reset(seed=1)
    where = {key: array.__array_interface__["data"][0] for key, array in obs.items()}
    for actions in actions_of(30, 2):  # over ends of episodes too
        obs, *_ = envs.step(actions)
        assert {key: array.__array_interface__["data"][0] for key, array in obs.items()} == where
    for name, *_ in envs.batch.sensors():
        assert envs.batch.rows(name).__array_interface__["data"][0] == where[name]


def test_dlpack_shares_the_memory(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=2)
    obs, _ = envs.reset(seed=1)
    shared = np.from_dlpack(obs["depth"])
    assert shared.__array_interface__["data"][0] == obs["depth"].__array_interface__["data"][0]
    before = shared.copy()
    for actions in np.full((3, 2), 2, dtype=np.int32):
        envs.step(actions)
    assert np.array_equal(shared, obs["depth"])
    assert not np.array_equal(shared, before)


def test_copies_on_request_stay(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=2, copy=True)
    first, _ = envs.reset(seed=1)
    kept = {key: array.copy() for key, array in first.items()}
    second, *_ = envs.step(np.array([2, 2]))
    assert equal(first, kept)
    assert not np.array_equal(second["depth"], first["depth"])


@pytest.mark.parametrize("mode", MODES)
def test_mode_is_in_the_metadata(small: Make, mode: str) -> None:
    envs = earshot.make_vec(small(), num_envs=1, autoreset_mode=mode)
    assert envs.metadata["autoreset_mode"] is MODES[mode]
    assert earshot.make_vec(small(), num_envs=1, autoreset_mode=MODES[mode]).metadata == envs.metadata  # type: ignore[arg-type]


def test_same_step_keeps_the_last_observation_apart(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=3, autoreset_mode="same_step", copy=True)
    lasting = earshot.make_vec(small(), num_envs=3, autoreset_mode="disabled", copy=True)
    envs.reset(seed=7)
    lasting.reset(seed=7)
    actions = actions_of(12, 3)
    actions[4, 1] = STOP
    ended = np.zeros(3, dtype=bool)
    for step, action in enumerate(actions):
        obs, _, terminated, truncated, infos = envs.step(action)
        done = terminated | truncated
        if ended.any():
            break
        expected, _, expected_terminated, expected_truncated, expected_infos = lasting.step(action)
        assert np.array_equal(terminated, expected_terminated)
        assert np.array_equal(truncated, expected_truncated)
        if not done.any():
            assert "final_obs" not in infos
            assert equal(obs, expected)
            continue
        assert step == 4
        assert done.tolist() == [False, True, False]
        assert infos["_final_obs"].tolist() == infos["_final_info"].tolist() == done.tolist()
        assert infos["final_obs"][0] is None
        assert equal(infos["final_obs"][1], {key: array[1] for key, array in expected.items()})
        assert not equal(infos["final_obs"][1], {key: array[1] for key, array in obs.items()})
        assert infos["final_info"]["steps"].tolist() == [0, 5, 0]
        assert infos["final_info"]["_steps"].tolist() == done.tolist()
        assert expected_infos["steps"].tolist() == [0, 5, 0]
        assert expected_infos["_success"].tolist() == done.tolist()
        ended = done
    assert ended.any()


def test_next_step_begins_in_the_step_after_an_end(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=2, autoreset_mode="next_step", copy=True)
    envs.reset(seed=7)
    _, _, terminated, _, infos = envs.step(np.array([STOP, FORWARD]))
    assert terminated.tolist() == [True, False]
    assert infos["_success"].tolist() == [True, False]
    obs, rewards, terminated, truncated, _ = envs.step(np.array([FORWARD, FORWARD]))
    assert rewards[0] == 0
    assert not (terminated | truncated).any()
    assert obs["previous_action"][0, 0] == -1


def test_disabled_waits_for_a_reset_by_mask(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=3, autoreset_mode="disabled", copy=True)
    envs.reset(seed=7)
    before, _, terminated, *_ = envs.step(np.array([STOP, FORWARD, 2]))
    assert terminated.tolist() == [True, False, False]
    with pytest.raises(RuntimeError, match="the episode of environment 0 has ended and autoreset is off; reset it first"):
        envs.step(np.array([FORWARD, FORWARD, FORWARD]))
    after, _ = envs.reset(options={"reset_mask": terminated})
    assert after["previous_action"][:, 0].tolist() == [-1, FORWARD, 2]
    for key in after:
        assert np.array_equal(after[key][1:], before[key][1:])
    envs.step(np.array([FORWARD, FORWARD, FORWARD]))


@pytest.mark.parametrize(
    ("mask", "error"),
    [([True, False], TypeError), (np.array([1, 0]), TypeError), (np.ones(3, bool), ValueError), (np.zeros(2, bool), ValueError)],
)
def test_a_wrong_mask_is_refused(small: Make, mask: Any, error: type[Exception]) -> None:
    envs = earshot.make_vec(small(), num_envs=2)
    envs.reset(seed=1)
    with pytest.raises(error, match=r"^options\['reset_mask'\] must (be a numpy array of bool|have shape \(2,\))"):
        envs.reset(options={"reset_mask": mask})


def roll_out(envs: Any, seed: Any, steps: int = 20) -> list[Any]:
    obs, _ = envs.reset(seed=seed)
    trace = [{key: array.copy() for key, array in obs.items()}]
    for actions in actions_of(steps, envs.num_envs):
        obs, rewards, terminated, truncated, _ = envs.step(actions)
        trace.append({**{key: array.copy() for key, array in obs.items()}, "r": rewards, "e": terminated | truncated})
    return trace


def test_seeds_give_bits_and_do_not_depend_on_threads(small: Make) -> None:
    first = roll_out(earshot.make_vec(small(), num_envs=3, threads=1), 11)
    second = roll_out(earshot.make_vec(small(), num_envs=3, threads=3), 11)
    assert all(equal(a, b) for a, b in zip(first, second, strict=True))
    envs = earshot.make_vec(small(), num_envs=3)
    roll_out(envs, 4)
    assert all(equal(a, b) for a, b in zip(first, roll_out(envs, [11, 12, 13]), strict=True))
    assert not equal(first[0], roll_out(envs, 5, steps=1)[0])


def test_an_own_seed_is_the_same_in_any_env(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=3, copy=True)
    obs, _ = envs.reset(seed=[5, None, 5])
    for key in obs:
        assert np.array_equal(obs[key][0], obs[key][2])


@pytest.mark.parametrize("mode", ["same_step", "next_step"])
def test_record_episode_statistics(small: Make, mode: str) -> None:
    envs = RecordEpisodeStatistics(earshot.make_vec(small(), num_envs=3, autoreset_mode=mode))
    envs.reset(seed=1)
    seen: list[tuple[float, int]] = []
    engine: list[tuple[float, int]] = []
    for actions in actions_of(40, 3):
        *_, infos = envs.step(actions)
        if "episode" not in infos:
            continue
        source = infos["final_info"] if mode == "same_step" else infos
        for env in np.flatnonzero(infos["_episode"]):
            seen.append((float(infos["episode"]["r"][env]), int(infos["episode"]["l"][env])))
            engine.append((float(source["episode_return"][env]), int(source["steps"][env])))
    assert len(seen) >= 6
    assert [length for _, length in seen] == [length for _, length in engine]
    assert np.allclose([total for total, _ in seen], [total for total, _ in engine], atol=1e-4)


def test_reset_masks_pass_the_wrapper_that_records(small: Make) -> None:
    envs = RecordEpisodeStatistics(earshot.make_vec(small(), num_envs=2, autoreset_mode="disabled"))
    envs.reset(seed=1)
    envs.step(np.array([FORWARD, FORWARD]))
    envs.reset(options={"reset_mask": np.array([True, False])})
    assert envs.episode_lengths.tolist() == [0, 1]


def test_infos_split_into_a_list(small: Make) -> None:
    envs = DictInfoToList(earshot.make_vec(small(), num_envs=2, autoreset_mode="next_step"))
    envs.reset(seed=1)
    *_, infos = envs.step(np.array([STOP, FORWARD]))
    assert infos[0]["steps"] == 1
    assert infos[1] == {}


def test_snapshots_go_on_with_the_same_bits(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=2, copy=True)
    envs.reset(seed=1)
    envs.step(np.array([FORWARD, 2]))
    state = envs.batch.snapshot(0)
    expected, *_ = envs.step(np.array([3, 3]))
    envs.batch.restore(1, state)
    again, *_ = envs.step(np.array([3, 3]))
    for key in expected:
        assert np.array_equal(again[key][1], expected[key][0])


def test_closing_frees_and_arrays_stay_valid(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=2)
    obs, _ = envs.reset(seed=1)
    kept = obs["depth"]
    value = kept.copy()
    envs.close()
    envs.close()
    assert envs.closed
    with pytest.raises(RuntimeError, match="closed"):
        envs.step(np.array([1, 1]))
    gone = weakref.ref(envs)
    del envs, obs
    gc.collect()
    assert gone() is None
    assert np.array_equal(kept, value)


def test_memory_does_not_grow_with_batches(small: Make) -> None:
    def resident_kb() -> int:
        with open("/proc/self/status") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))

    def once() -> None:
        envs = earshot.make_vec(small(), num_envs=4)
        envs.reset(seed=1)
        envs.step(np.full(4, FORWARD))
        envs.close()
        gc.collect()

    for _ in range(3):
        once()
    before = resident_kb()
    for _ in range(6):
        once()
    assert resident_kb() - before < 60_000  # a batch of this size and its scene hold more than 20 MB


def test_wrong_arguments_are_exceptions(small: Make) -> None:
    envs = earshot.make_vec(small(), num_envs=2)
    envs.reset(seed=1)
    calls: list[tuple[Callable[[], Any], str]] = [
        (lambda: earshot.make_vec(small(), num_envs=0), "make_vec: num_envs is 0; give an integer from 1"),
        (lambda: earshot.make_vec(small(thread=3), num_envs=1), "config:1: thread: unknown key; did you mean 'threads'?"),
        (lambda: earshot.make_vec({"seed": 1}, num_envs=1), "config: episodes: is missing"),
        (lambda: earshot.make_vec("absent.yaml", num_envs=1), "make_vec: config absent.yaml cannot be read"),
        (
            lambda: earshot.make_vec(small(), num_envs=1, autoreset_mode="later"),
            "make_vec: autoreset_mode is 'later'; give one of same_step",
        ),
        (lambda: earshot.make_vec(small(), overrides=["task.max_stepps=3"]), "override 'task.max_stepps=3': task.max_stepps: unknown key"),
        (lambda: envs.step(np.array([1, 1, 1])), "step: actions have shape (3,); give [2] integers"),
        (lambda: envs.step(np.array([1, 9])), "step: actions have the value 9; give integers from 0 to 3"),
        (lambda: envs.reset(seed=[1]), "reset: seed has 1 entries for 2 envs"),
        (lambda: envs.reset(seed=-1), "reset: seed is -1; give an integer from 0"),
    ]
    for call, words in calls:
        with pytest.raises(earshot.InputError, match=f"^{re.escape(words)}"):
            call()
    with pytest.raises(TypeError, match=r"^step: actions are of type float64; give integers from 0 to 3$"):
        envs.step(np.array([0.5, 1.5]))


def test_a_run_config_is_read_by_its_env_and_data(small: Make, tmp_path: Any) -> None:
    import json

    config = small()
    episodes = config.pop("episodes")
    path = tmp_path / "run.yaml"
    run = {"name": "x", "ppo": {"epochs": 3}, "env": config, "data": {"train": episodes}}
    path.write_text(json.dumps(run))
    from_file = earshot.make_vec(path, num_envs=2, overrides=["env.task.step_reward=-0.5"], copy=True)
    from_dict = earshot.make_vec(small(), num_envs=2, overrides=["task.step_reward=-0.5"], copy=True)
    assert "step_reward: -0.5" in from_file.batch.config_text
    assert equal(from_file.reset()[0], from_dict.reset()[0])
