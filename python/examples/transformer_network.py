# SPDX-License-Identifier: Apache-2.0
"""A transformer over the last 32 steps as a file for `policy.module` (docs/howto/own_network.md).

python transformer_network.py net.pt --depth 64x64x1 --sound interaural:65x26x4
earshot train CONFIG policy.module=net.pt
"""

from __future__ import annotations

import argparse

import torch
from avnav_network import encoder
from torch import Tensor, nn


class Transformer(nn.Module):
    """State: the tokens of the last steps, and 1 where there was such a step, [N, memory, size + 1].  Attention: Vaswani et al. 2017."""

    def __init__(self, depth: list[int], sound: str, sound_shape: list[int], size: int, memory: int, channels: int) -> None:
        super().__init__()
        self.sound, self.size, self.memory = sound, size, memory
        widths, is_small = [channels, 2 * channels, 2 * channels], min(sound_shape[:2]) < 30
        self.visual = encoder(depth, [8, 4, 3], [4, 2, 2], widths, size)
        self.audio = encoder(sound_shape, [5, 3, 3] if is_small else [8, 4, 3], [2, 2, 1] if is_small else [4, 2, 1], widths, size)
        self.token, self.places = nn.Linear(2 * size, size), nn.Parameter(0.02 * torch.randn(memory, size))
        self.norms = nn.ModuleList([nn.LayerNorm(size), nn.LayerNorm(size)])
        self.projected, self.mixed = nn.Linear(size, 3 * size), nn.Linear(size, size)
        self.layers = nn.Sequential(nn.LayerNorm(size), nn.Linear(size, 2 * size), nn.ReLU(), nn.Linear(2 * size, size))
        self.actor, self.critic = nn.Linear(size, 4), nn.Linear(size, 1)
        nn.init.orthogonal_(self.actor.weight, 0.01)

    def encoded(self, depth: Tensor, sound: Tensor) -> Tensor:
        return self.token(torch.cat([self.audio(sound.permute(0, 3, 1, 2)), self.visual(depth.permute(0, 3, 1, 2))], 1))

    def remembered(self, state: Tensor, token: Tensor) -> Tensor:
        return torch.cat([state[:, 1:], torch.cat([token, torch.ones_like(token[:, :1])], 1).unsqueeze(1)], 1)

    def attended(self, state: Tensor) -> Tensor:
        """[N, memory, size + 1] -> [N, size], by four heads that see the steps that there were."""
        tokens = state[:, :, : self.size] + self.places
        split = self.projected(self.norms[0](tokens)).unflatten(2, [3, 4, self.size // 4])  # [N, memory, 3, heads, size / heads]
        query, key, value = split[:, -1:, 0].transpose(1, 2), split[:, :, 1].permute(0, 2, 3, 1), split[:, :, 2].transpose(1, 2)
        scores = (query @ key) / (self.size / 4) ** 0.5
        weights = scores.masked_fill(state[:, None, None, :, self.size] < 0.5, -1e9).softmax(3)
        last = tokens[:, -1] + self.mixed((weights @ value).flatten(1))
        return self.norms[1](last + self.layers(last))

    @torch.jit.export
    def initial_state(self) -> Tensor:
        return torch.zeros(self.memory, self.size + 1)

    def forward(self, observations: dict[str, Tensor], state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        state = self.remembered(state, self.encoded(observations["depth"], observations[self.sound]))
        seen = self.attended(state)
        return self.actor(seen), self.critic(seen), state

    @torch.jit.export
    def sequence(self, observations: dict[str, Tensor], state: Tensor, begins: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        tokens = self.encoded(observations["depth"].flatten(0, 1), observations[self.sound].flatten(0, 1)).unflatten(0, begins.shape)
        states: list[Tensor] = []
        for step in range(begins.size(0)):
            state = self.remembered(torch.where(begins[step][:, None, None], torch.zeros_like(state), state), tokens[step])
            states.append(state)
        seen = self.attended(torch.cat(states)).unflatten(0, begins.shape)
        return self.actor(seen), self.critic(seen), state


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", help="TorchScript file to write")
    parser.add_argument("--depth", default="128x128x1", help="shape of the depth picture")
    parser.add_argument("--sound", default="spectrogram:65x26x2", help="name and shape of the sensor of sound")
    for name, default in {"size": 128, "memory": 32, "channels": 32, "seed": 1}.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    args = parser.parse_args()
    torch.manual_seed(args.seed)
    sensor, _, sizes = args.sound.partition(":")
    shapes = [[int(extent) for extent in text.split("x")] for text in (args.depth, sizes)]
    torch.jit.script(Transformer(shapes[0], sensor, shapes[1], args.size, args.memory, args.channels)).save(args.file)
