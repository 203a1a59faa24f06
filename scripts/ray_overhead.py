#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Processor time of a corpus and of an evaluation by earshot.ray on two local nodes of one core, over that of one process of two threads.

    PYTHONPATH=build/release/python_package EARSHOT_PROGRAM=$PWD/build/release/earshot VENV/bin/python scripts/ray_overhead.py

VENV has ray[data,tune] and gymnasium.  Processor time counts all processes: the nodes, their workers, the program and the caller, but
not the start of the cluster.  Both ways take turns; the medians are compared.  With two
idle cores the wall times are comparable as well.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path


def processor_s() -> float:
    """User and system time of this process and all below it, those that have ended included."""
    parents: dict[int, int] = {}
    ticks: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue  # it has just ended
            parents[int(entry.name)] = int(fields[1])
            ticks[int(entry.name)] = sum(int(field) for field in fields[11:15])
    mine = {os.getpid()}
    while more := {pid for pid, parent in parents.items() if parent in mine} - mine:
        mine |= more
    return sum(ticks.get(pid, 0) for pid in mine) / os.sysconf("SC_CLK_TCK")


def cost(work: Callable[[], object]) -> tuple[float, float]:
    begin, wall = processor_s(), time.monotonic()
    work()
    return processor_s() - begin, time.monotonic() - wall


def compare(name: str, one: Callable[[], object], parts: Callable[[], object], rounds: int, idle: float) -> None:
    """idle: processor time that the cluster takes in a second without work, of which a loaded machine shows more than an idle one."""
    times = [(cost(one), cost(parts)) for _ in range(rounds)]
    for kind, value in (
        ("processor time", lambda processor, wall: processor),
        ("processor time less that of the idle cluster", lambda processor, wall: processor - idle * wall),
        ("wall time", lambda processor, wall: wall),
    ):
        alone, spread = (statistics.median(value(*pair[way]) for pair in times) for way in (0, 1))
        ratios = [value(*pair[1]) / value(*pair[0]) - 1 for pair in times]
        print(
            f"{name}: {kind} {alone:.2f} s in one process, {spread:.2f} s with Ray: {100 * (spread / alone - 1):+.1f} % "
            f"(rounds {100 * min(ratios):+.1f} to {100 * max(ratios):+.1f} %)",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--rooms", type=int, default=80, help="rooms of 100 responses; ten are a part")
    parser.add_argument("--shared", action="store_true", help="the nodes write to the corpus themselves")
    parser.add_argument("--no-evaluation", action="store_true")
    args = parser.parse_args()
    import ray
    from ray.cluster_utils import Cluster

    import earshot.ray

    os.environ.setdefault("RAY_worker_niceness", "0")  # as the one process
    program = os.environ["EARSHOT_PROGRAM"]
    root = Path(__file__).resolve().parent.parent
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "object_store_memory": 1_000_000_000, "include_dashboard": False})
    cluster.add_node(num_cpus=1, object_store_memory=1_000_000_000)
    ray.init(address=cluster.address, log_to_driver=False)
    ray.get([ray.remote(lambda: __import__("earshot.ray")).options(scheduling_strategy="SPREAD").remote() for _ in range(4)])  # warm workers
    processor, wall = cost(lambda: time.sleep(20))
    idle = processor / wall
    print(f"idle cluster: {1000 * idle:.0f} ms of processor time per second", flush=True)
    with tempfile.TemporaryDirectory(prefix="earshot-overhead-") as folder:
        os.chdir(folder)
        corpus = [str(root / "configs/datasets/rir.yaml"), "--set", f"shoeboxes.count={args.rooms}", "--set", "scenes=[]"]

        def one_corpus() -> None:
            shutil.rmtree("one", ignore_errors=True)
            subprocess.run([program, "dataset", "rir", *corpus, "--out", "one", "--threads", "2"], check=True, stdout=subprocess.DEVNULL)

        def ray_corpus() -> None:
            shutil.rmtree("parts", ignore_errors=True)
            earshot.ray.corpus("rir", corpus, out="parts", shared=args.shared, progress=False)

        compare(f"corpus of {100 * args.rooms} responses", one_corpus, ray_corpus, args.rounds, idle)
        same = subprocess.run(["diff", "-r", "one", "parts"], check=False).returncode == 0
        print("equal byte for byte" if same else "NOT EQUAL")
        if not args.no_evaluation:
            config = str(root / "configs/train/quick.yaml")
            keys = ["--set", f"data.eval.file={folder}/eval.json.gz", "--set", "data.eval.scenes=[house:100..103]", "--set", f"out={folder}/run"]
            episodes = [*keys, "--set", f"data.train.file={folder}/train.json.gz", "--set", "data.train.scenes=[house:1]"]
            subprocess.run([program, "dataset", "episodes", "--config", config, *episodes], check=True, stdout=subprocess.DEVNULL)
            agent = [str(root / "configs/policies/quick.policy"), *keys]

            def one_evaluation() -> None:
                command = [program, "eval", *agent, "--out", "one.json", "--workers", "2"]
                subprocess.run(command, check=True, stdout=subprocess.DEVNULL)

            def ray_evaluation() -> None:
                earshot.ray.evaluate(agent[0], agent[1:], out="parts.json", progress=False)

            compare("evaluation", one_evaluation, ray_evaluation, args.rounds, idle)
            print("equal byte for byte" if Path("one.json").read_bytes() == Path("parts.json").read_bytes() else "NOT EQUAL")
    ray.shutdown()
    cluster.shutdown()


if __name__ == "__main__":
    main()
