# SPDX-License-Identifier: Apache-2.0
"""The quick task with PPO in the manner of CleanRL, in one loop; ppo.py has the long form with a network for pictures.

pip install 'earshot-rl[gym]' torch
python cleanrl_ppo.py --minutes 15
"""

from __future__ import annotations

import argparse
import time
from collections import deque

import gymnasium
import numpy as np
import torch
from gymnasium.wrappers.vector import FlattenObservation
from torch import nn

import earshot

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--id", default="earshot/AudioGoal-v0", choices=earshot.env_ids())
parser.add_argument("--minutes", type=float, default=15)
parser.add_argument("--num-envs", type=int, default=16)
args = parser.parse_args()
torch.manual_seed(1)
envs = FlattenObservation(gymnasium.make_vec(args.id, num_envs=args.num_envs, threads=0))
T, N, size = 64, args.num_envs, envs.single_observation_space.shape[0]  # type: ignore[index]
body = nn.Sequential(nn.Linear(size, 128), nn.Tanh(), nn.Linear(128, 128), nn.Tanh())
actor, critic = nn.Linear(128, 4), nn.Linear(128, 1)
with torch.no_grad():
    actor.weight.mul_(0.01)
    actor.bias.copy_(torch.tensor([-4.0, 0, 0, 0]))  # `stop` ends an episode: rare at first
network = nn.ModuleList([body, actor, critic])
optimizer = torch.optim.Adam(network.parameters(), lr=7e-4, eps=1e-5)

obs, acts = torch.zeros(T + 1, N, size), torch.zeros(T, N, dtype=torch.int64)
logs, rewards, alive, used = torch.zeros(T, N), torch.zeros(T, N), torch.zeros(T, N), torch.zeros(T, N)
obs[0] = torch.from_numpy(envs.reset(seed=1)[0])
begins = torch.zeros(N)  # 1: this step begins an episode and takes no action ("next_step")
recent: deque[float] = deque(maxlen=200)
begin, steps = time.perf_counter(), 0
while time.perf_counter() - begin < 60 * args.minutes:
    for t in range(T):
        with torch.no_grad():
            policy = torch.distributions.Categorical(logits=actor(body(obs[t])))
            acts[t] = policy.sample()
            logs[t] = policy.log_prob(acts[t])
        row, reward, terminated, truncated, infos = envs.step(acts[t].numpy())
        obs[t + 1], rewards[t], used[t] = torch.from_numpy(row), torch.from_numpy(reward), 1 - begins
        begins = torch.from_numpy((terminated | truncated).astype(np.float32))
        alive[t] = 1 - torch.from_numpy(terminated.astype(np.float32))
        recent.extend(infos["success"][infos["_success"]] if "success" in infos else ())
        steps += N
    with torch.no_grad():
        values = critic(body(obs)).squeeze(-1)  # [T + 1, N]: the last observation of an episode stands in its own row
        advantages, running = torch.zeros(T, N), torch.zeros(N)
        for t in reversed(range(T)):
            delta = rewards[t] + 0.99 * alive[t] * values[t + 1] - values[t]
            running = used[t] * (delta + 0.99 * 0.95 * alive[t] * running)
            advantages[t] = running
        returns = advantages + values[:-1]
    for _ in range(3):
        for rows in torch.nonzero(used.flatten()).squeeze(-1)[torch.randperm(int(used.sum()))].chunk(2):
            features = body(obs[:-1].flatten(0, 1)[rows])
            policy = torch.distributions.Categorical(logits=actor(features))
            gain = advantages.flatten()[rows]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            ratio = (policy.log_prob(acts.flatten()[rows]) - logs.flatten()[rows]).exp()
            loss = -torch.min(ratio * gain, ratio.clamp(0.8, 1.2) * gain).mean() - 0.01 * policy.entropy().mean()
            loss = loss + 0.5 * (critic(features).squeeze(-1) - returns.flatten()[rows]).pow(2).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimizer.step()
    obs[0] = obs[-1]
    seconds, success = time.perf_counter() - begin, np.mean(recent) if recent else 0.0
    print(f"{seconds:6.0f} s {steps:8d} steps {steps / seconds:6.0f} steps/s  success {success:.2f}", flush=True)
envs.close()
