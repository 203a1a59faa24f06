# SPDX-License-Identifier: Apache-2.0
"""Faults of a run of several workers as lines of text, in the form of tests/support/simulation/fault_schedule.h; which are drawn, and with which
workers a run goes on after them (trainer/net/membership.h)."""

import dataclasses
import pathlib
import random
from typing import ClassVar


@dataclasses.dataclass
class Fault:
    kind: str
    rank: int = 0
    other: int = 0
    group: int = 0  # bit r: rank r
    at_s: float = 0.0  # since the first updates
    duration_s: float = 0.0
    amount: float = 0.0  # delay in s; fraction of lost frames

    KEYS: ClassVar = {"kill": ("rank",), "stop": ("rank", "duration_s"), "cut": ("group", "duration_s"), "cut_way": ("rank", "other", "duration_s"),
            "delay": ("rank", "amount", "duration_s"), "lose": ("rank", "amount", "duration_s"), "kill_at_end": ("rank", "duration_s")}

    def line(self) -> str:
        return f"{self.kind} at_s={self.at_s:.3f} " + " ".join(f"{key}={getattr(self, key):.6g}" for key in self.KEYS[self.kind])

    @staticmethod
    def parse(line: str) -> "Fault":
        """ValueError for a line that real processes are not made to suffer."""
        kind, *pairs = line.split()
        if kind not in Fault.KEYS:
            raise ValueError(f"'{line}': real processes suffer {', '.join(Fault.KEYS)}")
        values = dict(pair.split("=") for pair in pairs)
        if unknown := set(values) - {"at_s", *Fault.KEYS[kind]}:
            raise ValueError(f"'{line}': {', '.join(sorted(unknown))} is not among the keys at_s, {', '.join(Fault.KEYS[kind])}")
        numbers = {key: float(value) if key in ("at_s", "duration_s", "amount") else int(float(value)) for key, value in values.items()}
        fault = Fault(kind, **numbers)
        if kind == "lose" and not 0 <= fault.amount <= 1:
            raise ValueError(f"'{line}': amount is the fraction of lost frames, 0 to 1")
        return fault

    @property
    def is_short(self) -> bool:
        """Over before anyone can count as lost: a heartbeat of 0.15 s is missed four times first."""
        return self.kind == "delay" or (self.kind in ("stop", "cut", "cut_way") and self.duration_s < 0.3)

    @property
    def label(self) -> str:
        names = {"kill": "killed", "kill_at_end": "killed as the run ends", "delay": "delayed link", "lose": "lossy link"}
        short = {"stop": "paused", "cut": "link down for a moment", "cut_way": "one way down for a moment"}
        long = {"stop": "stopped", "cut": "network cut in two", "cut_way": "one way cut"}
        return names.get(self.kind) or (short if self.is_short else long)[self.kind]


def has_quorum(part: set[int], members: set[int]) -> bool:
    return 2 * len(part) > len(members) or (2 * len(part) == len(members) and min(members) in part)


def may_be_left(fault: Fault, members: set[int]) -> list[set[int]]:
    """Sets of workers with which the run may go on after the fault; none where it ends."""
    rest = members - {fault.rank}
    if fault.is_short:
        return [members]
    if fault.kind == "kill":
        return [rest] if has_quorum(rest, members) else []
    if fault.kind == "stop":  # who wakes as the half with the lowest rank goes on alone
        return [rest] if has_quorum(rest, members) else [members - rest]
    if fault.kind == "cut":
        inside = {rank for rank in members if fault.group >> rank & 1}
        return [part for part in (inside, members - inside) if has_quorum(part, members)]
    if fault.kind == "lose":  # enough lost frames look like a lost host
        return [members] + [part for part in (rest, members - rest) if has_quorum(part, members)]
    pair = {fault.rank, fault.other}  # each may find that it does not reach the other
    return [part for part in (rest, members - {fault.other}, members - pair) if part and has_quorum(part, members)]


def draw_fault(draw: random.Random, members: set[int], is_last: bool) -> Fault:
    rank = draw.choice(sorted(members))
    other = draw.choice(sorted(members - {rank}))
    if is_last and draw.random() < 0.5:
        return Fault("kill_at_end", rank, duration_s=draw.uniform(0, 0.2))
    kind = draw.choice(["kill", "kill", "stop", "cut", "cut_way", "pause", "blink", "delay", "delay", "lose"])
    long_s, short_s = draw.uniform(3, 4), draw.uniform(0.05, 0.2)
    if kind == "kill":
        return Fault("kill", rank)
    if kind in ("stop", "pause"):
        return Fault("stop", rank, duration_s=long_s if kind == "stop" else short_s)
    if kind in ("cut", "blink"):
        group = 0
        while not 0 < group.bit_count() < len(members):
            group = sum(1 << member for member in members if draw.random() < 0.4)
        return Fault("cut", group=group, duration_s=long_s if kind == "cut" else short_s)
    if kind == "cut_way":
        return Fault("cut_way", rank, other, duration_s=long_s if draw.random() < 0.7 else short_s)
    if kind == "delay":
        return Fault("delay", rank, amount=draw.uniform(0.002, 0.03), duration_s=draw.uniform(0.5, 1.5))
    return Fault("lose", rank, amount=draw.uniform(0.01, 0.1), duration_s=draw.uniform(0.5, 1.5))


def read_schedule(file: str) -> list[Fault]:
    lines = pathlib.Path(file).read_text().splitlines()
    return [Fault.parse(line) for line in lines if line.strip() and not line.startswith("#")]
