# SPDX-License-Identifier: Apache-2.0
"""Adapters of earshot.integrations against the real packages.

Each test skips where its framework is missing, as in scripts/test_python.sh, which installs none of them.  To run those of one framework::

    python3 -m venv venv && venv/bin/pip install stable-baselines3 pytest gymnasium
    PYTHONPATH=build/release/python_package venv/bin/python -m pytest -rs python/tests/test_frameworks.py
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

import earshot
from earshot._seeds import spread_seeds
from earshot.integrations._common import require
from earshot.integrations._plain import FlatRows, PlainBatch

Make = Callable[..., dict[str, Any]]
#: Frameworks that pin gymnasium below 1.0 do without its VectorEnv.
vectors = pytest.mark.skipif(int(gymnasium.__version__.split(".")[0]) < 1, reason="gymnasium below 1.0")
ACTIONS = np.random.default_rng(7).choice(4, size=(25, 3), p=[0.1, 0.5, 0.2, 0.2])


def expected_steps(config: dict[str, Any], mode: str) -> tuple[Any, list[Any]]:
    """The first observations and the steps of ACTIONS, from the VectorEnv that the other tests check."""
    envs = earshot.make_vec(config, 3, autoreset_mode=mode, copy=True)
    first, _ = envs.reset(seed=spread_seeds(11, 3))
    return first, [envs.step(actions) for actions in ACTIONS]


def same(a: Any, b: Any) -> bool:
    return set(a) == set(b) and all(np.array_equal(np.asarray(a[key]), np.asarray(b[key])) for key in b)


@vectors
def test_the_plain_batch_steps_as_the_vector_env(small: Make) -> None:
    first, steps = expected_steps(small(), "same_step")
    plain = PlainBatch(small(), 3)
    plain.reset(11)
    flat = FlatRows(plain.sensors)
    rows = np.zeros((3, *flat.space.shape), dtype=np.float32)
    assert same(plain.rows(), first)
    ends = 0
    for actions, (obs, rewards, terminated, truncated, infos) in zip(ACTIONS, steps, strict=True):
        metrics = plain.step(actions)
        assert same(plain.rows(), obs)
        assert np.array_equal(plain.rewards, rewards)
        assert np.array_equal(plain.terminated, terminated)
        assert np.array_equal(plain.truncated, truncated)
        for env in np.flatnonzero(terminated | truncated):
            assert metrics[env]["steps"] == infos["final_info"]["steps"][env]
            ends += 1
        flat.write(rows)
        for name, (begin, end, shape) in flat.slices.items():
            scale = 255 if obs[name].dtype == np.uint8 and len(shape) == 3 else 1
            assert np.allclose(rows[:, begin:end].reshape(3, *shape), obs[name] / scale, atol=1e-6)
    assert ends >= 4
    plain.close()
    with pytest.raises(RuntimeError, match="closed"):
        plain.step(ACTIONS[0])


@vectors
@pytest.mark.parametrize("kind", ["vector", "vector, off", "single", "agents", "plain"])
def test_every_info_says_which_episodes_were_faulty(small: Make, kind: str) -> None:
    faulty = small(stage_limit_s=1e-9)  # most stages take longer
    makers: dict[str, Callable[[], Any]] = {
        "vector": lambda: earshot.make_vec(faulty, 2, autoreset_mode="same_step"),
        "vector, off": lambda: earshot.make_vec(faulty, 2, autoreset_mode="disabled"),
        "single": lambda: earshot.make(faulty),
        "agents": lambda: earshot.parallel_env({**faulty, "agents": 2}),
        "plain": lambda: PlainBatch(faulty, 2),
    }
    env = makers[kind]()
    rng = np.random.default_rng(3)
    seen = 0
    for _ in range(300):
        if not env.batch.has_started or kind not in ("vector", "plain"):
            env.reset()
        if kind == "plain":
            infos = env.step(rng.integers(1, 4, 2))
        elif kind == "agents":
            infos = list(env.step({agent: int(rng.integers(1, 4)) for agent in env.agents})[4].values())
        elif kind == "single":
            infos = [env.step(int(rng.integers(1, 4)))[4]]
        else:
            masks = env.step(rng.integers(1, 4, 2))[4]
            infos = [{"quarantined": True} if flag else {} for flag in masks.get("_quarantined", np.zeros(2, bool))]
        flags = env.batch.quarantined().astype(bool).tolist()
        assert [info.get("quarantined", False) for info in infos] == flags
        assert not any("success" in info for info in infos if info.get("quarantined"))  # a faulty episode has no metrics
        seen += sum(flags)
        if seen >= 3:
            break
    assert seen >= 3


@pytest.mark.parametrize(
    ("module", "package", "extra"),
    [
        pytest.param("stable_baselines3", "stable_baselines3", "sb3", marks=vectors),
        pytest.param("torchrl", "torch", "torchrl", marks=vectors),
        pytest.param("rllib", "ray", "rllib", marks=vectors),
        ("pufferlib", "pufferlib", "puffer"),
        ("sample_factory", "sample_factory", "sample-factory"),
    ],
)
def test_a_missing_framework_is_named_with_its_extra(module: str, package: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib
    import sys

    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(sys.modules, f"earshot.integrations.{module}", raising=False)
    with pytest.raises(ImportError, match=rf"earshot.integrations needs {package}: pip install 'earshot-rl\[{extra}\]'"):
        importlib.import_module(f"earshot.integrations.{module}")


@pytest.mark.parametrize(("version", "is_refused"), [("2.0.6", True), ("3.0.0", False), ("10.1", False)])
def test_a_framework_that_is_too_old_is_named_with_the_version(version: str, is_refused: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.metadata.version", lambda _: version)
    if not is_refused:
        assert require("json", "puffer", at_least=3).dumps
        return
    with pytest.raises(ImportError, match=r"^json 2\.0\.6 is too old: pip install 'json>=3\.0'$"):
        require("json", "puffer", at_least=3)


def test_stable_baselines3_gets_the_steps_of_the_batch(small: Make) -> None:
    pytest.importorskip("stable_baselines3", reason="no stable-baselines3")
    from earshot.integrations.stable_baselines3 import EarshotVecEnv

    first, steps = expected_steps(small(), "same_step")
    envs = EarshotVecEnv(small(), 3)
    envs.seed(11)
    assert same(envs.reset(), first)
    ends = 0
    for actions, (obs, rewards, terminated, truncated, infos) in zip(ACTIONS, steps, strict=True):
        own, own_rewards, dones, own_infos = envs.step(actions)
        assert same(own, obs)
        assert np.array_equal(own_rewards, rewards)
        assert dones.tolist() == (terminated | truncated).tolist()
        for env, info in enumerate(own_infos):
            assert ("terminal_observation" in info) == bool(dones[env])
            if not dones[env]:
                continue
            ends += 1
            assert same(info["terminal_observation"], infos["final_obs"][env])
            assert info["TimeLimit.truncated"] == bool(truncated[env] and not terminated[env])
            assert info["episode"]["l"] == infos["final_info"]["steps"][env]
            assert info["success"] == infos["final_info"]["success"][env]
    assert ends >= 4
    assert envs.get_attr("scene_name") == ["house:1,rooms=3,area_m2=36"] * 3
    envs.set_attr("mark", 5, indices=[1])
    assert envs.get_attr("mark", indices=1) == [5]
    assert len(envs.env_method("snapshot", indices=[0, 2])) == 2


def test_stable_baselines3_trains(small: Make, tmp_path: Any) -> None:
    sb3 = pytest.importorskip("stable_baselines3", reason="no stable-baselines3")
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    from earshot.integrations.stable_baselines3 import EarshotVecEnv

    config = small()
    config["observation"]["rgb"] = False  # 16 pixels are too few for the network of Stable-Baselines3
    envs = VecNormalize(VecMonitor(EarshotVecEnv(config, 3)), norm_obs=False)
    model = sb3.PPO("MultiInputPolicy", envs, n_steps=16, batch_size=24, n_epochs=1, seed=1, device="cpu")
    model.learn(96)
    assert model.num_timesteps >= 96
    assert len(model.ep_info_buffer) >= 3
    model.save(tmp_path / "model.zip")
    again = sb3.PPO.load(tmp_path / "model.zip", env=envs, device="cpu")
    rewards, lengths = evaluate_policy(again, EarshotVecEnv(config, 2), n_eval_episodes=3, return_episode_rewards=True, warn=False)
    assert len(rewards) == len(lengths) >= 3
    assert max(lengths) <= 12


def test_torchrl_specs_and_steps(small: Make) -> None:
    torch = pytest.importorskip("torch", reason="no torch")
    pytest.importorskip("torchrl", reason="no torchrl")
    from torchrl.envs.utils import check_env_specs

    from earshot.integrations.torchrl import EarshotTorchRLEnv

    check_env_specs(EarshotTorchRLEnv(small(), 3))
    env, plain = EarshotTorchRLEnv(small(), 3), earshot.make_vec(small(), 3, autoreset_mode="disabled", copy=True)
    env.set_seed(11)
    expected, _ = plain.reset(seed=spread_seeds(11, 3))
    data = env.reset()
    ends = 0
    for actions in ACTIONS:
        assert all(np.array_equal(data[name].numpy(), expected[name]) for name in expected)
        data["action"] = torch.from_numpy(actions)
        step, data = env.step_and_maybe_reset(data)
        obs, rewards, terminated, truncated, infos = plain.step(actions)
        assert all(np.array_equal(step["next", name].numpy(), obs[name]) for name in obs)
        assert np.array_equal(step["next", "reward"].numpy()[:, 0], rewards)
        assert np.array_equal(step["next", "terminated"].numpy()[:, 0], terminated)
        assert np.array_equal(step["next", "truncated"].numpy()[:, 0], truncated)
        ended = terminated | truncated
        if ended.any():
            ends += int(ended.sum())
            assert np.array_equal(step["next", "metrics", "steps"].numpy()[:, 0], infos["steps"])
            obs, _ = plain.reset(options={"reset_mask": ended})
        expected = obs
    assert ends >= 4
    rollout = env.rollout(30, break_when_any_done=False)
    assert rollout.shape == (3, 30)


def test_torchrl_and_stable_baselines3_mark_faulty_episodes(small: Make) -> None:
    torch = pytest.importorskip("torch", reason="no torch")
    pytest.importorskip("torchrl", reason="no torchrl")
    pytest.importorskip("stable_baselines3", reason="no stable-baselines3")
    from torchrl.envs.utils import check_env_specs

    from earshot.integrations.stable_baselines3 import EarshotVecEnv
    from earshot.integrations.torchrl import EarshotTorchRLEnv

    faulty = small(stage_limit_s=1e-9)
    env, envs = EarshotTorchRLEnv(faulty, 2), EarshotVecEnv(faulty, 2)
    check_env_specs(env)
    data = env.reset()
    envs.reset()
    marked = [0, 0]
    for _ in range(300):
        if min(marked) >= 2:
            break
        data["action"] = torch.tensor([1, 2])
        step, data = env.step_and_maybe_reset(data)
        assert step["next", "quarantined"].dtype == torch.bool
        assert not (step["next", "quarantined"] & ~step["next", "done"]).any()
        marked[0] += int(step["next", "quarantined"].sum())
        _, _, dones, infos = envs.step(np.array([1, 2]))
        flags = envs.envs.batch.quarantined().astype(bool)
        assert [info.get("quarantined", False) for info in infos] == flags.tolist()
        marked[1] += int(flags.sum())
        assert dones[flags].all()
    assert min(marked) >= 2


def test_supersuit_makes_batches_of_agents(small: Make) -> None:
    supersuit = pytest.importorskip("supersuit", reason="no supersuit")
    from pettingzoo.test import parallel_api_test

    from earshot.integrations.supersuit import flat_parallel_env

    parallel_api_test(flat_parallel_env(small(agents=2)), num_cycles=30)
    env = supersuit.black_death_v3(flat_parallel_env(small(agents=2)))
    envs = supersuit.concat_vec_envs_v1(supersuit.pettingzoo_env_to_vec_env_v1(env), 2, num_cpus=1, base_class="gymnasium")
    rows, _ = envs.reset()
    assert rows.shape[0] == 4
    assert not np.array_equal(rows[:2], rows[2:])  # each copy has episodes of its own
    ends = 0
    for _ in range(30):
        rows, rewards, terminated, truncated, _ = envs.step(np.random.default_rng(1).integers(0, 4, size=4))
        assert rows.shape[0] == len(rewards) == 4
        ends += int((np.asarray(terminated) | np.asarray(truncated)).sum())
    assert ends >= 2
    frames = supersuit.frame_stack_v1(flat_parallel_env(small(agents=2)), 2)
    first, _ = frames.reset(seed=1)
    assert len(first) == 2


def test_rllib_runs_a_batch(small: Make) -> None:
    pytest.importorskip("ray.rllib", reason="no ray[rllib]")
    pytest.importorskip("torch", reason="no torch")
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner

    from earshot.integrations.rllib import register

    for mode, count in (("vector_entry_point", 3), ("sync", 2)):
        config = PPOConfig().environment(register(f"small-{mode}", small()))
        config.env_runners(num_envs_per_env_runner=count, gym_env_vectorize_mode=mode)
        runner = SingleAgentEnvRunner(config=config)
        episodes = runner.sample(num_timesteps=90, random_actions=True)
        assert sum(len(episode) for episode in episodes) >= 90
        ended = [episode for episode in episodes if episode.is_done]
        assert len(ended) >= 3
        assert all(episode.get_infos(-1)["steps"] == len(episode) for episode in ended)
        runner.stop()


def test_pufferlib_takes_the_batch(small: Make) -> None:
    pytest.importorskip("pufferlib", reason="no pufferlib")
    import pufferlib
    import pufferlib.vector

    from earshot.integrations.pufferlib import EarshotPufferEnv

    keys = {"config": small(), "num_envs": 3}
    envs = pufferlib.vector.make(EarshotPufferEnv, env_kwargs=keys, backend=pufferlib.PufferEnv)
    plain = PlainBatch(small(), 3)
    plain.reset(11)
    flat = FlatRows(plain.sensors)
    expected = np.zeros((3, *flat.space.shape), dtype=np.float32)
    envs.async_reset(11)
    ends = 0
    for actions in ACTIONS:
        rows, *_ = envs.recv()
        flat.write(expected)
        assert np.array_equal(rows, expected)
        ended = [end for end in plain.step(actions) if end]
        envs.send(actions)
        assert [info["steps"] for info in envs.infos] == [end["steps"] for end in ended]
        ends += len(ended)
    assert ends >= 4


def test_sample_factory_takes_the_batch(small: Make) -> None:
    pytest.importorskip("sample_factory", reason="no sample-factory")
    from sample_factory.algo.utils.make_env import BatchedVecEnv

    from earshot.integrations.sample_factory import EarshotSampleFactoryEnv

    env = EarshotSampleFactoryEnv(small(), 3)
    boxes: dict[str, Any] = dict(env.observation_space.spaces)  # type: ignore[attr-defined]
    obs, infos = env.reset(seed=11)
    assert len(infos) == 3
    assert all(obs[name].shape == (3, *box.shape) and obs[name].dtype == box.dtype for name, box in boxes.items())
    plain = PlainBatch(small(), 3)
    envs = BatchedVecEnv(env)
    envs.seed(4)  # as a worker does; the first reset takes it
    tensors, _ = envs.reset()
    plain.reset(4)
    ends = 0
    for actions in ACTIONS:
        for name, array in plain.rows().items():
            found = tensors[name].numpy()
            rows = np.moveaxis(array, -1, 1) if array.ndim == 4 else array  # channels first, in one row where a side is short
            assert np.array_equal(found, rows.reshape(found.shape).astype(found.dtype))
        tensors, rewards, terminated, truncated, infos = envs.step(actions)
        metrics = plain.step(actions)
        assert np.array_equal(rewards, plain.rewards)
        assert np.array_equal(terminated, plain.terminated)
        assert np.array_equal(truncated, plain.truncated)
        assert [info.get("episode_extra_stats", {}) for info in infos] == metrics
        ends += sum(bool(end) for end in metrics)
    assert ends >= 4
