# SPDX-License-Identifier: Apache-2.0
"""The quick task with the trainer of PufferLib 3 on the CPU.

pip install 'earshot-rl[puffer]' torch
python puffer_ppo.py --minutes 15
"""

from __future__ import annotations

import argparse
import ast
import configparser
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pufferlib
import pufferlib.models
import pufferlib.vector
import torch
from pufferlib.pufferl import PuffeRL

from earshot.integrations.pufferlib import EarshotPufferEnv


def train_section() -> dict[str, Any]:
    """The defaults of PufferLib."""
    ini = configparser.ConfigParser()
    ini.read(Path(pufferlib.__file__).parent / "config" / "default.ini")
    section: dict[str, Any] = {}
    for key, text in ini["train"].items():
        try:
            section[key] = ast.literal_eval(text)
        except (ValueError, SyntaxError):
            section[key] = text
    return section


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", default="earshot:train/quick")
    parser.add_argument("--minutes", type=float, default=15)
    parser.add_argument("--num-envs", type=int, default=16)
    args = parser.parse_args()

    torch.manual_seed(1)
    keys = {"config": args.config, "num_envs": args.num_envs, "threads": 0}
    envs = pufferlib.vector.make(EarshotPufferEnv, env_kwargs=keys, backend=pufferlib.PufferEnv)
    policy = pufferlib.models.Default(envs.driver_env)
    with torch.no_grad():
        policy.decoder.bias[0] = -4.0  # `stop` ends an episode: rare at first
    horizon = 64
    config = {
        **train_section(),
        **{"env": "earshot", "device": "cpu", "optimizer": "adam", "use_rnn": False, "seed": 1, "total_timesteps": 10_000_000},
        **{"bptt_horizon": horizon, "batch_size": 2 * horizon * args.num_envs, "minibatch_size": horizon * args.num_envs},
        **{"learning_rate": 7e-4, "update_epochs": 3, "ent_coef": 0.01, "checkpoint_interval": 10**9, "gamma": 0.99},
    }
    trainer = PuffeRL(config, envs, policy)
    trainer.print_dashboard = lambda *_, **__: None
    recent: deque[float] = deque(maxlen=200)
    begin = time.perf_counter()
    while time.perf_counter() - begin < 60 * args.minutes:
        recent.extend(trainer.evaluate()["success"])
        trainer.train()
        trainer.stats.clear()
        seconds, success = time.perf_counter() - begin, np.mean(recent) if recent else 0.0
        print(
            f"{seconds:6.0f} s {trainer.global_step:8d} steps {trainer.global_step / seconds:6.0f} steps/s  success {success:.2f}",
            flush=True,
        )
    envs.close()


if __name__ == "__main__":
    main()
