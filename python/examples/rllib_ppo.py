# SPDX-License-Identifier: Apache-2.0
"""The quick task with PPO of RLlib: a runner steps one batch.

pip install 'earshot-rl[rllib]' torch
python rllib_ppo.py --minutes 15
"""

from __future__ import annotations

import argparse
import time
from typing import Any

from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.callbacks.callbacks import RLlibCallback

from earshot.integrations.rllib import register


class Success(RLlibCallback):
    """Reports the success of ended episodes."""

    def on_episode_end(self, *, episode: Any, metrics_logger: Any, **_: Any) -> None:
        info = episode.get_infos(-1)
        if "success" in info:
            metrics_logger.log_value("success", float(info["success"]), window=200)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", default="earshot:train/quick")
    parser.add_argument("--minutes", type=float, default=15)
    parser.add_argument("--num-envs", type=int, default=16)
    args = parser.parse_args()

    config = (
        PPOConfig()
        .environment(register("earshot-quick", args.config, threads=0))
        .env_runners(num_env_runners=0, num_envs_per_env_runner=args.num_envs, gym_env_vectorize_mode="vector_entry_point")
        .training(lr=7e-4, train_batch_size=64 * args.num_envs, minibatch_size=512, num_epochs=3, entropy_coeff=0.01, grad_clip=1.0)
        .rl_module(model_config={"fcnet_hiddens": [128, 128]})
        .learners(num_learners=0)
        .callbacks(Success)
        .debugging(seed=1)
    )
    algorithm = config.build_algo()
    begin, steps = time.perf_counter(), 0
    while time.perf_counter() - begin < 60 * args.minutes:
        result = algorithm.train()
        runners = result["env_runners"]
        steps = int(runners["num_env_steps_sampled_lifetime"])
        seconds = time.perf_counter() - begin
        success = runners.get("success", 0.0)
        print(f"{seconds:6.0f} s {steps:8d} steps {steps / seconds:6.0f} steps/s  success {success:.2f}", flush=True)
    algorithm.stop()


if __name__ == "__main__":
    main()
