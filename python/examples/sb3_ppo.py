# SPDX-License-Identifier: Apache-2.0
"""The quick task with PPO of Stable-Baselines3; the config is that of `earshot train configs/train/quick.yaml`.

pip install 'earshot-rl[sb3]'
python sb3_ppo.py --minutes 15
"""

from __future__ import annotations

import argparse
import time
from collections import deque
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from earshot.integrations.stable_baselines3 import EarshotVecEnv


class Report(BaseCallback):
    """A line per rollout; ends the training after so many minutes."""

    def __init__(self, minutes: float) -> None:
        super().__init__()
        self.begin, self.minutes = time.perf_counter(), minutes
        self.ends: deque[tuple[float, float]] = deque(maxlen=200)

    def _on_step(self) -> bool:
        self.ends.extend((info["success"], info["spl"]) for info in self.locals["infos"] if "success" in info)
        return time.perf_counter() - self.begin < 60 * self.minutes

    def _on_rollout_end(self) -> None:
        seconds = time.perf_counter() - self.begin
        success, spl = np.mean(self.ends, axis=0) if self.ends else (0.0, 0.0)
        rate = self.num_timesteps / seconds
        print(f"{seconds:6.0f} s {self.num_timesteps:8d} steps {rate:6.0f} steps/s  success {success:.2f} SPL {spl:.2f}", flush=True)


def train(config: str, num_envs: int, minutes: float) -> PPO:
    envs = EarshotVecEnv(config, num_envs, threads=0)
    envs.seed(1)
    options: dict[str, Any] = {
        "n_steps": 64,
        "batch_size": 512,
        "n_epochs": 3,
        "gamma": 0.99,
        "learning_rate": 7e-4,
        "ent_coef": 0.01,
        "max_grad_norm": 1.0,
        "policy_kwargs": {"net_arch": [128]},
    }
    model = PPO("MultiInputPolicy", envs, seed=1, device="cpu", **options)
    with torch.no_grad():  # `stop` ends an episode: rare at first
        model.policy.action_net.bias[0] = -4.0
    model.learn(10**9, callback=Report(minutes))
    envs.close()
    return model


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", default="earshot:train/quick")
    parser.add_argument("--minutes", type=float, default=15)
    parser.add_argument("--num-envs", type=int, default=16)
    parser.add_argument("--save", help="where the trained policy goes (.zip)")
    args = parser.parse_args()
    model = train(args.config, args.num_envs, args.minutes)
    if args.save:
        model.save(args.save)


if __name__ == "__main__":
    main()
