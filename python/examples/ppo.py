# SPDX-License-Identifier: Apache-2.0
"""PPO in one file (Schulman et al. 2017), in the manner of CleanRL: an agent walks to a sound in small houses.

    pip install earshot-rl[gym] torch
    python ppo.py --num-envs 16 --total-steps 200000

Prints a line per update: steps, steps/s, and the means over the last 100 episodes.  `--config` takes any config of earshot.make_vec, such
as configs/train/quick.yaml.  The network sees every sensor of float32 and every picture; it has no memory, unlike that of `earshot train`.
"""

from __future__ import annotations

import argparse
import time
from collections import deque
from typing import Any

import numpy as np
import torch
from torch import nn

import earshot

HOUSES: dict[str, Any] = {
    "threads": 0,
    "sound_gain": 12.566371,  # 4 pi: a source sounds as loud at 1 m as its dry clip
    "task": {"max_steps": 150, "step_reward": 0},
    "observation": {
        "camera": {"width_px": 32, "height_px": 32},
        "spectrogram": False,
        "interaural": True,
        "pointgoal": True,
        "collision": True,
    },
    "acoustics": {"preset": "fast", "rir_length_s": 0.3},
    "episodes": {
        "scenes": ["house:1000..1003,rooms=3,area_m2=36"],
        "sounds": ["synth:telephone:0..3"],
        "episodes_per_scene": 100,
        "goals_per_scene": 5,
        "filter": {"min_geodesic_m": 1.5, "max_geodesic_m": 12, "min_ratio": 1.0},
    },
}


class Agent(nn.Module):
    """Pictures [h, w, c] through a small convolution each, the rest as numbers; actor and critic share the body."""

    def __init__(self, shapes: dict[str, tuple[int, ...]], num_actions: int, hidden: int = 128) -> None:
        super().__init__()
        self.pictures = nn.ModuleDict()
        size = 0
        for name, shape in shapes.items():
            if len(shape) < 3:
                size += int(np.prod(shape))
                continue
            self.pictures[name] = nn.Sequential(
                nn.Conv2d(shape[2], 16, 5, stride=3),
                nn.ReLU(),
                nn.Conv2d(16, 32, 3, stride=2),
                nn.ReLU(),
                nn.AdaptiveAvgPool2d(4),
                nn.Flatten(),
                nn.Linear(512, hidden),
                nn.ReLU(),
            )
            size += hidden
        self.body = nn.Sequential(nn.Linear(size, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU())
        self.actor, self.critic = nn.Linear(hidden, num_actions), nn.Linear(hidden, 1)
        nn.init.orthogonal_(self.actor.weight, 0.01)
        with torch.no_grad():
            self.actor.bias.copy_(torch.tensor([-4.0] + [0.0] * (num_actions - 1)))  # `stop` ends an episode: rare at first

    def forward(self, obs: dict[str, torch.Tensor]) -> tuple[torch.distributions.Categorical, torch.Tensor]:
        parts = [
            self.pictures[name](value.movedim(-1, 1)) if name in self.pictures else value.flatten(1) for name, value in sorted(obs.items())
        ]
        features = self.body(torch.cat(parts, 1))
        return torch.distributions.Categorical(logits=self.actor(features)), self.critic(features).squeeze(-1)


def tensors(obs: dict[str, np.ndarray[Any, Any]]) -> dict[str, torch.Tensor]:
    """Copies, as the next step overwrites the arrays; bytes of pictures become [0, 1]."""
    return {name: torch.from_numpy(array.astype(np.float32) / (255 if array.dtype == np.uint8 else 1)) for name, array in obs.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", help="a YAML file (default: four small houses)")
    parser.add_argument("--num-envs", type=int, default=16)
    parser.add_argument("--num-steps", type=int, default=64, help="steps of an env between updates")
    parser.add_argument("--total-steps", type=int, default=200_000)
    parser.add_argument("--learning-rate", type=float, default=7e-4)
    parser.add_argument("--gamma", type=float, default=0.99)
    parser.add_argument("--gae-lambda", type=float, default=0.95)
    parser.add_argument("--epochs", type=int, default=3)
    parser.add_argument("--minibatches", type=int, default=4)
    parser.add_argument("--clip", type=float, default=0.2)
    parser.add_argument("--entropy", type=float, default=0.01)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()

    torch.manual_seed(args.seed)
    envs = earshot.make_vec(args.config or HOUSES, args.num_envs, autoreset_mode="same_step")
    obs_arrays, _ = envs.reset(seed=args.seed)
    obs = tensors(obs_arrays)
    agent = Agent({name: tuple(value.shape[1:]) for name, value in obs.items()}, 4)
    optimizer = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5)

    T, N = args.num_steps, args.num_envs  # noqa: N806
    kept = {name: torch.zeros((T, *value.shape)) for name, value in obs.items()}
    actions = torch.zeros((T, N), dtype=torch.int64)
    log_probs, rewards, values, ends = (torch.zeros((T, N)) for _ in range(4))
    recent: deque[tuple[float, float]] = deque(maxlen=100)
    begin, updates = time.perf_counter(), max(1, args.total_steps // (T * N))

    for update in range(updates):
        optimizer.param_groups[0]["lr"] = args.learning_rate * (1 - update / updates)
        for t in range(T):
            with torch.no_grad():
                policy, values[t] = agent(obs)
            actions[t] = policy.sample()
            log_probs[t] = policy.log_prob(actions[t])
            for name, value in obs.items():
                kept[name][t] = value
            next_obs, reward, terminated, truncated, infos = envs.step(actions[t].numpy())
            rewards[t] = torch.from_numpy(reward)
            ends[t] = torch.from_numpy((terminated | truncated).astype(np.float32))
            if truncated.any():  # out of steps: the value of the last observation stands for what would have followed
                with torch.no_grad():
                    for env in np.flatnonzero(truncated & ~terminated):
                        last = tensors({name: array[None] for name, array in infos["final_obs"][env].items()})
                        rewards[t, env] += args.gamma * agent(last)[1][0]
            if "final_info" in infos:
                final = infos["final_info"]
                recent.extend((final["success"][env], final["spl"][env]) for env in np.flatnonzero(infos["_final_info"]))
            obs = tensors(next_obs)

        with torch.no_grad():
            next_value = agent(obs)[1]
            advantages, running = torch.zeros_like(rewards), torch.zeros(N)
            for t in reversed(range(T)):
                alive = 1 - ends[t]
                delta = rewards[t] + args.gamma * alive * next_value - values[t]
                running = delta + args.gamma * args.gae_lambda * alive * running
                advantages[t], next_value = running, values[t]
            returns = advantages + values

        flat = {name: value.flatten(0, 1) for name, value in kept.items()}
        for _ in range(args.epochs):
            for rows in torch.randperm(T * N).chunk(args.minibatches):
                policy, value = agent({name: tensor[rows] for name, tensor in flat.items()})
                ratio = (policy.log_prob(actions.flatten()[rows]) - log_probs.flatten()[rows]).exp()
                gain = advantages.flatten()[rows]
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                surrogate = torch.min(ratio * gain, ratio.clamp(1 - args.clip, 1 + args.clip) * gain).mean()
                loss = 0.5 * (value - returns.flatten()[rows]).pow(2).mean() - surrogate - args.entropy * policy.entropy().mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 1.0)
                optimizer.step()

        steps = (update + 1) * T * N
        success, spl = np.mean(recent, axis=0) if recent else (0.0, 0.0)
        print(f"{steps:8d} steps  {steps / (time.perf_counter() - begin):6.0f} steps/s  success {success:.2f}  SPL {spl:.2f}", flush=True)
    envs.close()


if __name__ == "__main__":
    main()
