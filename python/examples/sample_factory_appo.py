# SPDX-License-Identifier: Apache-2.0
"""The quick task with APPO of Sample Factory, in one process; success is written to its summaries (TensorBoard) and printed at the end.

pip install 'earshot-rl[sample-factory]'     # an environment of its own: Sample Factory pins gymnasium below 1.0
python sample_factory_appo.py --minutes 15
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import numpy as np
from sample_factory.algo.runners.runner import Runner
from sample_factory.cfg.arguments import parse_full_cfg, parse_sf_args
from sample_factory.train import make_runner

from earshot.integrations.sample_factory import register


def arguments_of(minutes: float, num_envs: int) -> list[str]:
    options = {
        "algo": "APPO",
        "env": "earshot_quick",
        "experiment": "earshot_quick",
        "device": "cpu",
        "serial_mode": True,
        "async_rl": False,
        "batched_sampling": True,
        "num_workers": 1,
        "num_envs_per_worker": 1,
        "worker_num_splits": 1,
        "rollout": 64,
        "recurrence": 1,
        "use_rnn": False,
        "batch_size": 32 * num_envs,
        "num_batches_per_epoch": 2,
        "num_epochs": 3,
        "learning_rate": 7e-4,
        "exploration_loss_coeff": 0.01,
        "train_for_seconds": int(60 * minutes),
        "restart_behavior": "overwrite",
        "with_wandb": False,
    }
    return [f"--{key}={value}" for key, value in options.items()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", default="earshot:train/quick")
    parser.add_argument("--minutes", type=float, default=15)
    parser.add_argument("--num-envs", type=int, default=16)
    args = parser.parse_args()

    register("earshot_quick", args.config, args.num_envs, threads=0)
    sf_parser, _ = parse_sf_args(arguments_of(args.minutes, args.num_envs))
    cfg = parse_full_cfg(sf_parser, arguments_of(args.minutes, args.num_envs))
    runner: Runner
    cfg, runner = make_runner(cfg)
    success: list[float] = []

    def keep(_: Any, message: dict[str, Any], __: int) -> None:
        stats = message.get("episodic", {}).get("episode_extra_stats", {})
        success.append(float(np.mean(stats.get("success", 0.0))))

    runner.register_episodic_stats_handler(keep)
    status = runner.init()
    if not status:
        status = runner.run()
    seconds = max(runner.total_train_seconds, 1e-9)
    steps = sum(runner.env_steps.values())
    recent = np.mean(success[-200:]) if success else 0.0
    print(f"{seconds:6.0f} s {steps:8d} steps {steps / seconds:6.0f} steps/s  success {recent:.2f}")
    sys.exit(status)


if __name__ == "__main__":
    main()
