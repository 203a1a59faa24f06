#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Samples per second of one PPO update of the network that REQUEST describes, in torch as it is installed, on one thread.

Usage: bench_learner_torch.py REQUEST.json       (written by `earshot bench train`)
Prints one JSON line: samples_per_cpu_s, samples_per_s, torch.  Exit code 69: torch is not there.

The network is the one of policy/actor_critic.h with the same shapes, the loss that of trainer/learner/ppo.h; rows are drawn.  The recurrent layer is
torch's GRU over the steps between episode starts, as in the published code, pictures are permuted to channels first, Adam is torch's.
"""
import json
import sys
import time

try:
    import torch
    import torch.nn as nn
    import torch.nn.functional as F
except ImportError:
    sys.exit(69)


class Encoder(nn.Module):
    def __init__(self, picture):
        super().__init__()
        rows, columns, channels = picture["shape"]
        layers = []
        for i, (kernel, stride, out) in enumerate(picture["layers"]):
            layers.append(nn.Conv2d(channels, out, kernel, stride))
            if i + 1 < len(picture["layers"]):
                layers.append(nn.ReLU(True))
            rows, columns, channels = (rows - kernel) // stride + 1, (columns - kernel) // stride + 1, out
        self.stack = nn.Sequential(*layers, nn.Flatten(), nn.Linear(rows * columns * channels, picture["features"]), nn.ReLU(True))

    def forward(self, rows):
        return self.stack(rows.permute(0, 3, 1, 2))


class Policy(nn.Module):
    def __init__(self, request):
        super().__init__()
        hidden = request["hidden"]
        self.encoders = nn.ModuleList(Encoder(picture) for picture in request["pictures"])
        features = sum(picture["features"] for picture in request["pictures"]) + request["vector"]
        self.gru = nn.GRU(features, hidden)
        self.actor = nn.Linear(hidden, request["actions"])
        guide = request["guide"]
        self.critic_hidden = nn.Linear(hidden + guide, request["guided_width"]) if guide else None
        self.critic = nn.Linear(request["guided_width"] if guide else hidden, 1)
        self.goal = nn.Linear(hidden, request["goal"]) if request["goal"] else None

    def forward(self, pictures, vector, guide, state, not_done):
        steps, envs = not_done.shape
        features = [encoder(rows) for encoder, rows in zip(self.encoders, pictures)]
        if vector is not None:
            features.append(vector)
        x = torch.cat(features, 1).view(steps, envs, -1)
        starts = sorted({0, steps} | set((not_done[1:] == 0).any(1).nonzero().squeeze(1).add(1).tolist()))
        outputs, state = [], state.unsqueeze(0)
        for first, end in zip(starts[:-1], starts[1:]):
            part, state = self.gru(x[first:end], state * not_done[first].view(1, -1, 1))
            outputs.append(part)
        states = torch.cat(outputs).flatten(0, 1)
        read = states
        if self.critic_hidden is not None:
            read = F.relu(self.critic_hidden(torch.cat([states, guide], 1)))
        return self.actor(states), self.critic(read).squeeze(1), self.goal(states) if self.goal is not None else None


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        request = json.load(file)
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    torch.manual_seed(1)
    steps, envs, ppo = request["steps"], request["envs"], request["ppo"]
    policy = Policy(request)
    adam = torch.optim.Adam(policy.parameters(), lr=ppo["learning_rate"], eps=ppo["adam_epsilon"])
    pictures = [torch.rand(steps, envs, *picture["shape"]) for picture in request["pictures"]]
    vector = torch.rand(steps, envs, request["vector"]) if request["vector"] else None
    guide = torch.rand(steps, envs, request["guide"]) if request["guide"] else None
    target = torch.rand(steps, envs, request["goal"]) if request["goal"] else None
    hidden = torch.zeros(envs, request["hidden"])
    t, b = torch.arange(steps).view(-1, 1), torch.arange(envs).view(1, -1)
    not_done = ((t + 17 * b) % request["episode_steps"] != 0).float()
    actions = torch.randint(request["actions"], (steps, envs))
    old_log_prob = torch.full((steps, envs), 1.0 / request["actions"]).log()
    values, advantages = torch.randn(steps, envs), torch.randn(steps, envs)
    returns = values + advantages
    clip = ppo["clip"]

    def minibatch(index):
        def rows(slab):
            return slab.index_select(1, index).flatten(0, 1)

        logits, value, goal = policy([rows(p) for p in pictures], None if vector is None else rows(vector),
                                     None if guide is None else rows(guide), hidden.index_select(0, index), not_done.index_select(1, index))
        log_p = F.log_softmax(logits, 1)
        chosen = log_p.gather(1, rows(actions).unsqueeze(1)).squeeze(1)
        ratio, advantage = (chosen - rows(old_log_prob)).clamp(-20, 20).exp(), rows(advantages)
        policy_loss = -torch.min(ratio * advantage, ratio.clamp(1 - clip, 1 + clip) * advantage).mean()
        error = (value - rows(returns)).square()
        if ppo["clip_value_loss"]:
            old = rows(values)
            error = torch.max(error, (old + (value - old).clamp(-clip, clip) - rows(returns)).square())
        entropy = -(log_p.exp() * log_p).sum(1).mean()
        loss = policy_loss + 0.5 * ppo["value_coefficient"] * error.mean() - ppo["entropy_coefficient"] * entropy
        if request["imitation"]:
            loss = loss + F.nll_loss(log_p, rows(actions))
        if goal is not None:
            loss = loss + (goal - rows(target)).square().sum(1).mean()
        adam.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(policy.parameters(), ppo["max_gradient_norm"])
        adam.step()

    def update():
        for _ in range(ppo["epochs"]):
            for part in torch.randperm(envs).tensor_split(ppo["minibatches"]):
                if len(part) > 0:
                    minibatch(part)

    if request["warm_up"]:
        update()
    cpu, wall, updates = time.process_time(), time.perf_counter(), 0
    while updates == 0 or time.process_time() - cpu < request["seconds"]:
        update()
        updates += 1
    samples = updates * steps * envs * ppo["epochs"]
    print(json.dumps({"samples_per_cpu_s": samples / (time.process_time() - cpu), "samples_per_s": samples / (time.perf_counter() - wall),
                      "torch": torch.__version__}))


main()
