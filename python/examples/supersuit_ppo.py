# SPDX-License-Identifier: Apache-2.0
"""Agents of the quick task with one policy: PettingZoo, SuperSuit and PPO of Stable-Baselines3.

pip install 'earshot-rl[supersuit,sb3]'
python supersuit_ppo.py --minutes 15 --agents 1
"""

from __future__ import annotations

import argparse
import time
from collections import deque

import numpy as np
import supersuit
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from earshot.integrations.supersuit import flat_parallel_env


class Report(BaseCallback):
    """A line per rollout; ends the training after so many minutes."""

    def __init__(self, minutes: float) -> None:
        super().__init__()
        self.begin, self.minutes = time.perf_counter(), minutes
        self.ends: deque[float] = deque(maxlen=200)

    def _on_step(self) -> bool:
        self.ends.extend(info["success"] for info in self.locals["infos"] if "success" in info)
        return time.perf_counter() - self.begin < 60 * self.minutes

    def _on_rollout_end(self) -> None:
        seconds = time.perf_counter() - self.begin
        success = np.mean(self.ends) if self.ends else 0.0
        print(
            f"{seconds:6.0f} s {self.num_timesteps:8d} steps {self.num_timesteps / seconds:6.0f} steps/s  success {success:.2f}", flush=True
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", default="earshot:train/quick")
    parser.add_argument("--minutes", type=float, default=15)
    parser.add_argument("--num-envs", type=int, default=8)
    parser.add_argument("--agents", type=int, default=1)
    args = parser.parse_args()

    # Agents that have stopped stay in the batch with zeros until the episode ends for all.
    env = supersuit.black_death_v3(flat_parallel_env(args.config, overrides=[f"env.agents={args.agents}"]))
    envs = supersuit.pettingzoo_env_to_vec_env_v1(env)
    envs = supersuit.concat_vec_envs_v1(envs, args.num_envs, num_cpus=1, base_class="stable_baselines3")
    model = PPO("MlpPolicy", envs, n_steps=64, batch_size=256, n_epochs=3, learning_rate=7e-4, ent_coef=0.01, seed=None, device="cpu")
    model.learn(10**9, callback=Report(args.minutes))
    envs.close()


if __name__ == "__main__":
    main()
