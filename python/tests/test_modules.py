# SPDX-License-Identifier: Apache-2.0
"""Networks written in Python for `earshot train` and `earshot eval`: the examples, and a policy of Stable-Baselines3 on a board.

Needs torch, for the second test stable-baselines3, and EARSHOT_PROGRAM: a program with the libraries of the package
(python/tests/test_frameworks.py says how to install a framework).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import earshot

EXAMPLES = Path(__file__).parents[1] / "examples"
CONFIG = """
name: small
seed: 5
workers: 1
envs_per_worker: 2
rollout_steps: 8
out: {out}
env:
  task: {{max_steps: 20, step_reward: 0}}
  observation:
    camera: {{width_px: 48, height_px: 48}}
    spectrogram: false
    interaural: true
    collision: true
  acoustics: {{preset: fast, field: "off", rir_length_s: 0.2}}
  quarantine_dir: {out}/quarantine
data:
  train: {{file: {out}/train.json, seed: 1, {set}}}
  eval: {{file: {out}/eval.json, seed: 2, {set}}}
"""
SET = 'scenes: ["shoebox:6x5x3@0.3"], episodes_per_scene: 4, sounds: ["synth:telephone"], filter: {min_geodesic_m: 1, min_ratio: 1}'


@pytest.fixture
def examples(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Their folder, for imports among them."""
    monkeypatch.syspath_prepend(EXAMPLES)
    yield
    for name in ("avnav_network", "transformer_network", "sb3_ppo", "sb3_to_board"):
        sys.modules.pop(name, None)


def run(*words: Any) -> str:
    """The program, which does it."""
    program = os.environ.get("EARSHOT_PROGRAM")
    if not program:
        pytest.skip("EARSHOT_PROGRAM names no program")
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def small_config(folder: Path) -> Path:
    config = folder / "small.yaml"
    config.write_text(CONFIG.format(out=folder / "run", set=SET))
    run("dataset", "episodes", "--config", config)
    return config


@pytest.mark.parametrize(
    ("network", "sizes"),
    [("avnav", ["--features", "16", "--hidden", "16"]), ("transformer", ["--size", "16", "--memory", "4"])],
)
def test_the_networks_of_the_examples_train(network: str, sizes: list[str], tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="no torch")
    config, module = small_config(tmp_path), tmp_path / "net.pt"
    shapes = ["--depth", "48x48x1", "--sound", "interaural:65x26x4", "--channels", "4"]
    script = EXAMPLES / f"{network}_network.py"
    subprocess.run([sys.executable, "-W", "ignore", script, module, *shapes, *sizes], check=True)
    said = run("train", config, f"policy.module={module}", "total_steps=32")
    assert "2 updates, 32 steps" in said
    state = {"avnav": "state 16", "transformer": "state 4x17"}[network]
    described = run("policy", tmp_path / "run")
    assert "module v1" in described
    assert state in described


def test_a_policy_of_stable_baselines3_acts_on_the_board_as_in_its_framework(tmp_path: Path, examples: None) -> None:
    sb3 = pytest.importorskip("stable_baselines3", reason="no stable-baselines3")
    import torch
    from sb3_to_board import export

    from earshot.integrations.stable_baselines3 import EarshotVecEnv

    config = small_config(tmp_path)
    envs = EarshotVecEnv(config, 2)
    model = sb3.PPO("MultiInputPolicy", envs, n_steps=16, batch_size=16, n_epochs=1, seed=1, device="cpu")
    with torch.no_grad():
        model.policy.action_net.bias[0] = -6.0  # no `stop`: long episodes
    model.learn(64)
    envs.close()
    module, policy, result = tmp_path / "net.pt", tmp_path / "sb3.policy", tmp_path / "result.json"
    export(model, module)
    run("policy", module, "--run-config", config, "--set", "name=sb3", "--out", policy)
    run("eval", policy, "--episodes", tmp_path / "run" / "eval.json", "--argmax", "--set", "eval_envs=4", "--out", result)
    expected = [episode["actions"] for episode in json.loads(result.read_text())["episodes"]]

    batch = earshot.make_vec(config, 4, split="eval", overrides=["env.order=once"], autoreset_mode="same_step")
    observations, _ = batch.reset()
    done = np.zeros(4, bool)
    taken: list[list[int]] = [[] for _ in range(4)]
    while not done.all():
        actions, _ = model.predict(observations, deterministic=True)
        for env in np.flatnonzero(~done):
            taken[env].append(int(actions[env]))
        observations, _, terminated, truncated, _ = batch.step(actions)
        done |= terminated | truncated
    batch.close()
    assert taken == expected
    assert sum(map(len, taken)) > 20
