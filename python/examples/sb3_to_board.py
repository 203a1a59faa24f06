# SPDX-License-Identifier: Apache-2.0
"""From a training with Stable-Baselines3 to a row of a leaderboard: train, export, evaluate, verify, rank.

pip install 'earshot-rl[sb3]'
python sb3_to_board.py --minutes 15 --program build/release/earshot
"""

from __future__ import annotations

import argparse
import subprocess
from pathlib import Path
from typing import Any

import torch
from sb3_ppo import train
from torch import Tensor


class Exported(torch.nn.Module):
    """The trained policy with the signature of `policy.module` (docs/howto/own_network.md).  It has no memory."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observations: dict[str, Tensor], state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        actor, critic = self.policy.mlp_extractor(self.policy.extract_features(observations))
        return self.policy.action_net(actor), self.policy.value_net(critic), state


def export(model: Any, file: Path) -> None:
    """A trace: the networks of Stable-Baselines3 run the same operators for every observation."""
    rows = {name: torch.as_tensor(space.sample()[None]) for name, space in model.observation_space.items()}
    torch.jit.trace(Exported(model.policy.eval()), (rows, torch.zeros(1, 1))).save(str(file))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", default="configs/train/quick.yaml", help="run config with the sensors")
    parser.add_argument("--benchmark", default="configs/benchmarks/quick.yaml")
    parser.add_argument("--minutes", type=float, default=15)
    parser.add_argument("--num-envs", type=int, default=16)
    parser.add_argument("--program", default="earshot")
    parser.add_argument("--out", type=Path, default=Path("runs/sb3"), help="folder of the results")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    module, policy, result = (str(args.out / name) for name in ("net.pt", "sb3.policy", "sb3.json"))
    model = train(args.config, args.num_envs, args.minutes)
    export(model, Path(module))
    board = ["--benchmark", args.benchmark]
    for command in (
        ["policy", module, "--run-config", args.config, "--set", "name=sb3", "--out", policy],
        ["eval", policy, *board, "--out", result],
        ["verify", result, *board],
        ["leaderboard", result, *board, "--run-here", "sb3"],
    ):
        subprocess.run([args.program, *command], check=True)


if __name__ == "__main__":
    main()
