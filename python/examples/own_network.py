# SPDX-License-Identifier: Apache-2.0
"""Networks of one's own for `earshot train CONFIG policy.module=FILE` (docs/howto/own_network.md), as TorchScript files::

    python3 python/examples/own_network.py avnav net.pt --depth 64x64x1 --sound interaural:65x26x4
    python3 python/examples/own_network.py transformer net.pt --depth 64x64x1 --sound interaural:65x26x4

avnav: the published network of audio-visual navigation (Chen et al. 2020, SoundSpaces): a CNN for depth, one for sound, a GRU.
transformer: the same encoders, and attention over the last 32 steps in place of the GRU.

Needs torch: the distribution's python3-torch, or one of the package index whose files the program's libtorch reads.
"""

import argparse

import torch
from torch import Tensor, nn

NUM_ACTIONS = 4
Shape = tuple[int, ...]


def convolutions(shape: Shape, kernels: list[int], strides: list[int], channels: list[int], features: int) -> nn.Sequential:
    """[N, channels, rows, columns] -> [N, features]; no ReLU behind the last convolution, as published."""
    rows, columns, incoming = shape
    layers: list[nn.Module] = []
    for kernel, stride, outgoing in zip(kernels, strides, channels, strict=True):
        layers += [nn.Conv2d(incoming, outgoing, kernel, stride), nn.ReLU()]
        rows, columns, incoming = (rows - kernel) // stride + 1, (columns - kernel) // stride + 1, outgoing
    layers[-1] = nn.Flatten()
    return nn.Sequential(*layers, nn.Linear(rows * columns * incoming, features), nn.ReLU())


class Encoder(nn.Module):
    """Depth and sound -> [N, 2 * features]."""

    def __init__(self, depth: Shape, sound: str, sound_shape: Shape, features: int, channels: int) -> None:
        super().__init__()
        self.sound = sound
        widths = [channels, 2 * channels, 2 * channels]
        small = min(sound_shape[:2]) < 30
        self.visual = convolutions(depth, [8, 4, 3], [4, 2, 2], widths, features)
        self.audio = convolutions(sound_shape, [5, 3, 3] if small else [8, 4, 3], [2, 2, 1] if small else [4, 2, 1], widths, features)
        for part in self.modules():
            if isinstance(part, nn.Conv2d | nn.Linear):
                nn.init.kaiming_normal_(part.weight)
                nn.init.zeros_(part.bias)

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        depth = observations["depth"].permute(0, 3, 1, 2)
        sound = observations[self.sound].permute(0, 3, 1, 2)
        return torch.cat([self.audio(sound), self.visual(depth)], 1)


class Heads(nn.Module):
    def __init__(self, size: int) -> None:
        super().__init__()
        self.actor = nn.Linear(size, NUM_ACTIONS)
        self.critic = nn.Linear(size, 1)
        nn.init.orthogonal_(self.actor.weight, 0.01)
        nn.init.orthogonal_(self.critic.weight, 1.0)
        for layer in (self.actor, self.critic):
            nn.init.zeros_(layer.bias)

    def forward(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        return self.actor(rows), self.critic(rows).squeeze(1)


def flattened(observations: dict[str, Tensor]) -> dict[str, Tensor]:
    """[T, N, ...] -> [T * N, ...]"""
    rows: dict[str, Tensor] = {}
    for name, values in observations.items():
        rows[name] = values.flatten(0, 1)
    return rows


class AvNav(nn.Module):
    """State: that of a GRU, [N, hidden]."""

    def __init__(self, encoder: Encoder, features: int, hidden: int) -> None:
        super().__init__()
        self.encoder = encoder
        self.rnn = nn.GRUCell(2 * features, hidden)
        self.heads = Heads(hidden)
        self.hidden = hidden
        for weight in (self.rnn.weight_ih, self.rnn.weight_hh):
            for gate in range(3):
                nn.init.orthogonal_(weight[gate * hidden : (gate + 1) * hidden])
        nn.init.zeros_(self.rnn.bias_ih)
        nn.init.zeros_(self.rnn.bias_hh)

    @torch.jit.export
    def initial_state(self) -> Tensor:
        return torch.zeros(self.hidden)

    def forward(self, observations: dict[str, Tensor], state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        state = self.rnn(self.encoder(observations), state)
        logits, value = self.heads(state)
        return logits, value, state

    @torch.jit.export
    def sequence(self, observations: dict[str, Tensor], state: Tensor, begins: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Encodes all T * N rows at once; the recurrence alone goes step by step."""
        steps, rows = begins.shape
        features = self.encoder(flattened(observations)).view(steps, rows, -1)
        states: list[Tensor] = []
        for step in range(steps):
            state = torch.where(begins[step].unsqueeze(1), torch.zeros_like(state), state)
            state = self.rnn(features[step], state)
            states.append(state)
        logits, value = self.heads(torch.cat(states))
        return logits.view(steps, rows, -1), value.view(steps, rows), state


class Block(nn.Module):
    """Self-attention over tokens but those that are `absent`, and a layer for each token (Vaswani et al. 2017, norm first)."""

    def __init__(self, size: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.before_attention, self.before_layers = nn.LayerNorm(size), nn.LayerNorm(size)
        self.queries_keys_values, self.mixed = nn.Linear(size, 3 * size), nn.Linear(size, size)
        self.layers = nn.Sequential(nn.Linear(size, 2 * size), nn.ReLU(), nn.Linear(2 * size, size))

    def forward(self, tokens: Tensor, absent: Tensor) -> Tensor:
        count, length, size = tokens.shape
        split = self.queries_keys_values(self.before_attention(tokens)).view(count, length, 3, self.heads, size // self.heads)
        queries, keys, values = split.permute(2, 0, 3, 1, 4).unbind(0)
        scores = queries @ keys.transpose(2, 3) / (size / self.heads) ** 0.5
        weights = scores.masked_fill(absent[:, None, None, :], -1e9).softmax(3)
        tokens = tokens + self.mixed((weights @ values).transpose(1, 2).reshape(count, length, size))
        return tokens + self.layers(self.before_layers(tokens))


class Transformer(nn.Module):
    """State: the features of the last `memory` steps and whether there was such a step, [N, memory, size + 1]."""

    def __init__(self, encoder: Encoder, features: int, size: int, memory: int = 32, heads: int = 4) -> None:
        super().__init__()
        self.encoder = encoder
        self.token = nn.Linear(2 * features, size)
        self.places = nn.Parameter(0.02 * torch.randn(memory, size))
        self.blocks = nn.ModuleList([Block(size, heads) for _ in range(2)])
        self.heads = Heads(size)
        self.memory, self.size = memory, size

    @torch.jit.export
    def initial_state(self) -> Tensor:
        return torch.zeros(self.memory, self.size + 1)

    def remembered(self, state: Tensor, token: Tensor) -> Tensor:
        present = torch.ones(token.shape[0], 1)
        return torch.cat([state[:, 1:], torch.cat([token, present], 1).unsqueeze(1)], 1)

    def attended(self, state: Tensor) -> Tensor:
        tokens = state[:, :, : self.size] + self.places
        absent = state[:, :, self.size] < 0.5
        for block in self.blocks:
            tokens = block(tokens, absent)
        return tokens[:, -1]

    def forward(self, observations: dict[str, Tensor], state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        state = self.remembered(state, self.token(self.encoder(observations)))
        logits, value = self.heads(self.attended(state))
        return logits, value, state

    @torch.jit.export
    def sequence(self, observations: dict[str, Tensor], state: Tensor, begins: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        steps, rows = begins.shape
        tokens = self.token(self.encoder(flattened(observations))).view(steps, rows, -1)
        states: list[Tensor] = []
        for step in range(steps):
            state = torch.where(begins[step].view(-1, 1, 1), torch.zeros_like(state), state)
            state = self.remembered(state, tokens[step])
            states.append(state)
        logits, value = self.heads(self.attended(torch.cat(states)))
        return logits.view(steps, rows, -1), value.view(steps, rows), state


def shape_of(text: str) -> Shape:
    return tuple(int(extent) for extent in text.split("x"))


def main() -> None:
    parser = argparse.ArgumentParser(description="Write a network for policy.module")
    parser.add_argument("network", choices=["avnav", "transformer"])
    parser.add_argument("file", help="TorchScript file to write")
    parser.add_argument("--depth", default="128x128x1", help="shape of the depth picture")
    parser.add_argument("--sound", default="spectrogram:65x26x2", help="name and shape of the sensor of sound")
    parser.add_argument("--features", type=int, default=512, help="of each encoder")
    parser.add_argument("--hidden", type=int, default=512, help="size of the GRU's state or of a token")
    parser.add_argument("--channels", type=int, default=32, help="of the first convolution")
    parser.add_argument("--seed", type=int, default=1, help="of the initial weights")
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    sound, sound_shape = arguments.sound.split(":")
    encoder = Encoder(shape_of(arguments.depth), sound, shape_of(sound_shape), arguments.features, arguments.channels)
    network = AvNav if arguments.network == "avnav" else Transformer
    torch.jit.script(network(encoder, arguments.features, arguments.hidden)).save(arguments.file)


if __name__ == "__main__":
    main()
