# SPDX-License-Identifier: Apache-2.0
"""The published network of audio-visual navigation (Chen et al. 2020) as a file for `policy.module` (docs/howto/own_network.md).

python avnav_network.py net.pt --depth 64x64x1 --sound interaural:65x26x4
earshot train CONFIG policy.module=net.pt
"""

from __future__ import annotations

import argparse

import torch
from torch import Tensor, nn


def encoder(shape: list[int], kernels: list[int], strides: list[int], channels: list[int], features: int) -> nn.Sequential:
    """[N, channels, rows, columns] -> [N, features]; no ReLU behind the last convolution, as published."""
    rows, columns, incoming = shape
    layers: list[nn.Module] = []
    for kernel, stride, outgoing in zip(kernels, strides, channels, strict=True):
        layers += [nn.Conv2d(incoming, outgoing, kernel, stride), nn.ReLU()]
        rows, columns, incoming = (rows - kernel) // stride + 1, (columns - kernel) // stride + 1, outgoing
    return nn.Sequential(*layers[:-1], nn.Flatten(), nn.Linear(rows * columns * incoming, features), nn.ReLU())


class AvNav(nn.Module):
    """A CNN for depth, one for sound, a GRU.  State: that of the GRU, [N, hidden]."""

    def __init__(self, depth: list[int], sound: str, sound_shape: list[int], features: int, hidden: int, channels: int) -> None:
        super().__init__()
        self.sound, self.hidden = sound, hidden
        widths, is_small = [channels, 2 * channels, 2 * channels], min(sound_shape[:2]) < 30
        self.visual = encoder(depth, [8, 4, 3], [4, 2, 2], widths, features)
        self.audio = encoder(sound_shape, [5, 3, 3] if is_small else [8, 4, 3], [2, 2, 1] if is_small else [4, 2, 1], widths, features)
        self.rnn = nn.GRUCell(2 * features, hidden)
        self.actor, self.critic = nn.Linear(hidden, 4), nn.Linear(hidden, 1)
        for name, weight in self.named_parameters():
            if "bias" in name:
                nn.init.zeros_(weight)
            elif not name.startswith(("visual", "audio")):
                nn.init.orthogonal_(weight, 0.01 if name.startswith("actor") else 1.0)
            else:
                nn.init.kaiming_normal_(weight)

    def encoded(self, depth: Tensor, sound: Tensor) -> Tensor:
        return torch.cat([self.audio(sound.permute(0, 3, 1, 2)), self.visual(depth.permute(0, 3, 1, 2))], 1)

    @torch.jit.export
    def initial_state(self) -> Tensor:
        return torch.zeros(self.hidden)

    def forward(self, observations: dict[str, Tensor], state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        state = self.rnn(self.encoded(observations["depth"], observations[self.sound]), state)
        return self.actor(state), self.critic(state), state

    @torch.jit.export
    def sequence(self, observations: dict[str, Tensor], state: Tensor, begins: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Encodes all T x N pictures at once; the recurrence alone goes step by step."""
        features = self.encoded(observations["depth"].flatten(0, 1), observations[self.sound].flatten(0, 1)).unflatten(0, begins.shape)
        states: list[Tensor] = []
        for step in range(begins.size(0)):
            state = self.rnn(features[step], torch.where(begins[step].unsqueeze(1), torch.zeros_like(state), state))
            states.append(state)
        every = torch.stack(states)
        return self.actor(every), self.critic(every), state


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", help="TorchScript file to write")
    parser.add_argument("--depth", default="128x128x1", help="shape of the depth picture")
    parser.add_argument("--sound", default="spectrogram:65x26x2", help="name and shape of the sensor of sound")
    for name, default in {"features": 512, "hidden": 512, "channels": 32, "seed": 1}.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    args = parser.parse_args()
    torch.manual_seed(args.seed)
    sensor, _, sizes = args.sound.partition(":")
    shapes = [[int(extent) for extent in text.split("x")] for text in (args.depth, sizes)]
    torch.jit.script(AvNav(shapes[0], sensor, shapes[1], args.features, args.hidden, args.channels)).save(args.file)
