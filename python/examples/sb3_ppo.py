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
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecNormalize
from torch import Tensor, nn

from earshot.integrations.stable_baselines3 import EarshotVecEnv


class Senses(BaseFeaturesExtractor):
    """Convolutions over the picture of depth and over that of sound, which Stable-Baselines3 would take as plain numbers."""

    def __init__(self, space: Any, features: int = 128) -> None:
        pictures = {name: box.shape for name, box in space.spaces.items() if len(box.shape) == 3}
        super().__init__(space, features * len(pictures))
        self.networks = nn.ModuleDict({name: self.network(shape, features) for name, shape in pictures.items()})

    @staticmethod
    def network(shape: tuple[int, int, int], features: int) -> nn.Module:
        layers = [layer for c, filters in ((shape[2], 16), (16, 32), (32, 32)) for layer in (nn.Conv2d(c, filters, 3, 2), nn.ReLU())]
        size = nn.Sequential(*layers, nn.Flatten())(torch.zeros(1, shape[2], *shape[:2])).shape[1]
        return nn.Sequential(*layers, nn.Flatten(), nn.Linear(size, features), nn.ReLU())

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        return torch.cat([network(observations[name].permute(0, 3, 1, 2)) for name, network in self.networks.items()], 1)


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
        success, spl = np.mean(self.ends, axis=0) if self.ends else (0.0, 0.0)
        print(f"{time.perf_counter() - self.begin:6.0f} s {self.num_timesteps:8d} steps  success {success:.2f} SPL {spl:.2f}", flush=True)


def train(config: str, num_envs: int, minutes: float) -> PPO:
    envs = VecNormalize(EarshotVecEnv(config, num_envs, threads=0), norm_obs=False)
    envs.seed(1)
    rates: dict[str, Any] = {"n_steps": 64, "batch_size": 512, "n_epochs": 3, "learning_rate": 7e-4, "ent_coef": 0.01, "max_grad_norm": 1.0}
    senses: dict[str, Any] = {"features_extractor_class": Senses, "net_arch": [128]}
    model = PPO("MultiInputPolicy", envs, seed=1, device="cpu", policy_kwargs=senses, **rates)
    with torch.no_grad():  # `stop` ends an episode: rare at first
        model.policy.action_net.bias[0] = -4.0
    model.learn(10**9, callback=Report(minutes))
    envs.close()
    return model


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--config", default="earshot:train/quick")
    parser.add_argument("--minutes", type=float, default=15)
    parser.add_argument("--num-envs", type=int, default=16)
    parser.add_argument("--save", default="sb3.zip", help="where the trained policy goes")
    args = parser.parse_args()
    train(args.config, args.num_envs, args.minutes).save(args.save)
