#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Times of one work on 1 to 10,000 cores, by calculation: the tables of docs/howto/many_machines.md.

    scripts/cost_of_machines.py                          # the tables
    scripts/cost_of_machines.py --response-s 0.004       # with another input; --help lists them

Every input is an option; its default is a measured value, and the page names where it comes from.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any

CORES = (1, 16, 100, 1000, 10000)

#: Name, default, unit and meaning of each input.
INPUTS: list[tuple[str, float, str, str]] = [
    ("response_s", 0.00285, "s", "processor time of a response of configs/datasets/rir.yaml"),
    ("response_mb", 0.128, "MB", "bytes of such a response"),
    ("responses", 1e6, "", "responses of the corpus"),
    ("responses_per_part", 1000, "", "responses of a part: rooms_per_folder x sources x listeners"),
    ("part_start_s", 0.03, "s", "processor time to start the program for a part"),
    ("task_s", 0.1, "s", "processor time of Ray, the node and the caller for a part, without its bytes"),
    ("copy_s_per_mb", 0.008, "s/MB", "processor time of the bytes that a node sends to the caller"),
    ("caller_mb_per_s", 1000, "MB/s", "rate at which the caller of earshot.ray.corpus receives and writes"),
    ("shared_mb_per_s", 20000, "MB/s", "rate of a shared file system over all nodes"),
    ("queue_s", 5, "s", "time for a launcher or Ray to start all processes"),
    ("step_s", 0.00046, "s", "processor time of a step of one environment with all sensors"),
    ("episodes", 1000, "", "episodes of an evaluation"),
    ("steps_per_episode", 200, "", "steps of an episode"),
    ("round", 8, "", "episodes that a part plays at once (eval_envs)"),
    ("scene_s", 0.05, "s", "processor time to load a scene of an episode"),
    ("scenes", 50, "", "scenes of the evaluation"),
    ("runs", 30, "", "runs of a sweep"),
    ("run_core_s", 3600, "s", "processor time of a run"),
    ("rollout_s", 10, "s", "mean time of a rollout"),
    ("rollout_spread", 0.3, "", "its relative standard deviation"),
    ("learn_s", 8.8, "s", "learning time of an update"),
    ("sums", 4, "", "sums of gradients in an update"),
    ("sum_mb", 19.81, "MB", "bytes of a sum"),
    ("link_gbit_per_s", 25, "Gbit/s", "bandwidth of a link"),
    ("link_s", 5e-5, "s", "latency of a link with its sockets"),
    ("cores_per_host", 64, "", "cores, and workers, of a host that share its link"),
]


def largest_of(count: int) -> float:
    """Expected largest of `count` draws from the standard normal distribution, by integration of 1 - F^n and F^n (David and Nagaraja 2003)."""

    def below(x: float) -> float:
        return 0.5 * math.erfc(-x / math.sqrt(2))

    step, total, x = 1e-3, 0.0, -8.0
    while x < 8:
        middle = below(x + step / 2) ** count
        total += step * ((1 - middle) if x + step / 2 > 0 else -middle)
        x += step
    return total


def corpus_s(cores: int, i: Any, way: str) -> float:
    """Seconds of a corpus: the parts in rounds, or the slowest disk if that takes longer.  way: one, array, ray, ray_shared."""
    parts = math.ceil(i.responses / i.responses_per_part)
    part = i.part_start_s + i.response_s * i.responses / parts + (i.task_s if way.startswith("ray") else 0)
    part += i.copy_s_per_mb * i.response_mb * i.responses / parts if way == "ray" else 0
    disk = i.caller_mb_per_s if way in ("one", "ray") else i.shared_mb_per_s
    if way == "one":  # threads share the rooms of all parts
        return max(i.responses * i.response_s / cores, i.responses * i.response_mb / disk)
    if way == "array":  # each task takes every cores-th part, in one process
        work = i.part_start_s + math.ceil(parts / cores) * (part - i.part_start_s)
    else:
        work = math.ceil(parts / cores) * part
    return float(i.queue_s + max(work, i.responses * i.response_mb / disk))


def evaluation_s(cores: int, i: Any) -> float:
    """Seconds of an evaluation in as many parts as cores: the rounds of the part with most of them, and its scenes."""
    rounds = math.ceil(i.episodes / i.round)
    mine = math.ceil(rounds / min(cores, rounds))
    scenes = min(i.scenes, mine * i.round)
    return float(i.queue_s + i.part_start_s + scenes * i.scene_s + mine * i.round * i.steps_per_episode * i.step_s)


def sweep_s(cores: int, i: Any) -> float:
    """Seconds of a sweep whose runs take one core each."""
    return float(i.queue_s + math.ceil(i.runs / min(cores, i.runs)) * i.run_core_s)


def sum_s(workers: int, i: Any) -> float:
    """Seconds of a sum: within a host over its memory (left out: small beside the link), between hosts 2 (H - 1) steps of the ring."""
    hosts = math.ceil(workers / i.cores_per_host)
    if hosts < 2:
        return 0.0
    bytes_each = 2 * (hosts - 1) / hosts * i.sum_mb * 1e6
    return float(2 * (hosts - 1) * i.link_s + bytes_each / (i.link_gbit_per_s * 1e9 / 8))


def training_parts(workers: int, i: Any) -> tuple[float, float]:
    """Seconds of an update, and the fraction of it that one worker alone would need."""
    wait = i.rollout_s * (1 + i.rollout_spread * (largest_of(workers) if workers > 1 else 0))
    update = wait + i.learn_s + i.sums * sum_s(workers, i)
    return update, (i.rollout_s + i.learn_s) / update


def duration(seconds: float) -> str:
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def table(head: str, rows: list[tuple[str, Callable[[int], str]]]) -> str:
    lines = [f"| {head} | " + " | ".join(f"{cores:,}" for cores in CORES) + " |", "|---" * (len(CORES) + 1) + "|"]
    return "\n".join([*lines, *(f"| {name} | " + " | ".join(value(cores) for cores in CORES) + " |" for name, value in rows)])


def tables(i: Any) -> str:
    ways = {"one": "one machine", "ray": "`earshot.ray.corpus`", "ray_shared": "the same, `shared=True`", "array": "Slurm array"}

    def corpus(way: str) -> tuple[str, Callable[[int], str]]:
        return ways[way], lambda cores: "-" if way == "one" and cores > i.cores_per_host else duration(corpus_s(cores, i, way))

    works: list[tuple[str, Callable[[int], str]]] = [
        (f"evaluation of {i.episodes:,.0f} episodes", lambda cores: duration(evaluation_s(cores, i))),
        (f"sweep of {i.runs:,.0f} runs", lambda cores: duration(sweep_s(cores, i))),
    ]
    training: list[tuple[str, Callable[[int], str]]] = [
        ("update", lambda cores: duration(training_parts(cores, i)[0])),
        ("its sums", lambda cores: duration(i.sums * sum_s(cores, i))),
        ("efficiency of a worker", lambda cores: f"{training_parts(cores, i)[1]:.2f}"),
    ]
    blocks = [table("cores", [corpus(way) for way in ways]), table("cores", works), table("workers, one core each", training)]
    return "\n\n".join(blocks)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default, unit, meaning in INPUTS:
        parser.add_argument(f"--{name.replace('_', '-')}", type=float, default=default, help=f"{meaning} ({default:g} {unit})".replace(" )", ")"))
    print(tables(parser.parse_args()))


if __name__ == "__main__":
    main()
