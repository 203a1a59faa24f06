# SPDX-License-Identifier: Apache-2.0
"""The quick task with PPO of TorchRL.

pip install 'earshot-rl[torchrl]'
python torchrl_ppo.py --minutes 15
"""

from __future__ import annotations

import argparse
import time
from collections import deque

import numpy as np
import torch
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.modules import ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from earshot.integrations.torchrl import EarshotTorchRLEnv

SENSORS = ["depth", "interaural", "collision"]


class Body(nn.Module):
    """Sensors as one row through two layers."""

    def __init__(self, inputs: int, outputs: int, bias: list[float] | None = None) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(inputs, 128), nn.Tanh(), nn.Linear(128, 128), nn.Tanh(), nn.Linear(128, outputs))
        with torch.no_grad():
            self.layers[-1].weight.mul_(0.01)
            if bias:
                self.layers[-1].bias.copy_(torch.tensor(bias))

    def forward(self, depth: torch.Tensor, interaural: torch.Tensor, collision: torch.Tensor) -> torch.Tensor:
        return self.layers(torch.cat([depth.flatten(-3), interaural.flatten(-3), collision.float()], -1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", default="earshot:train/quick")
    parser.add_argument("--minutes", type=float, default=15)
    parser.add_argument("--num-envs", type=int, default=16)
    args = parser.parse_args()
    torch.manual_seed(1)
    env = EarshotTorchRLEnv(args.config, args.num_envs, threads=0)
    size = sum(int(np.prod(env.observation_spec[name].shape[1:])) for name in SENSORS)
    logits = TensorDictModule(Body(size, 4, [-4.0, 0, 0, 0]), in_keys=SENSORS, out_keys=["logits"])  # `stop` is rare at first
    actor = ProbabilisticActor(logits, in_keys=["logits"], distribution_class=torch.distributions.Categorical, return_log_prob=True)
    critic = ValueOperator(Body(size, 1), in_keys=SENSORS)
    loss = ClipPPOLoss(actor, critic, clip_epsilon=0.2, entropy_coeff=0.01, normalize_advantage=True)
    gae = GAE(gamma=0.99, lmbda=0.95, value_network=critic)
    optimizer = torch.optim.Adam(loss.parameters(), lr=7e-4)

    frames = 64 * args.num_envs
    recent, begin, steps = deque[float](maxlen=200), time.perf_counter(), 0
    for data in Collector(env, actor, frames_per_batch=frames, total_frames=-1):
        steps += data.numel()
        recent.extend(data["next", "metrics", "success"][data["next", "done"]].tolist())
        for _ in range(3):
            with torch.no_grad():
                gae(data)
            for rows in data.reshape(-1)[torch.randperm(frames)].split(frames // 2):
                losses = loss(rows)
                (losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 1.0)
                optimizer.step()
                optimizer.zero_grad()
        seconds, success = time.perf_counter() - begin, np.mean(recent) if recent else 0.0
        print(f"{seconds:6.0f} s {steps:8d} steps {steps / seconds:6.0f} steps/s  success {success:.2f}", flush=True)
        if seconds > 60 * args.minutes:
            break


if __name__ == "__main__":
    main()
