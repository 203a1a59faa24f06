# SPDX-License-Identifier: Apache-2.0
"""Training runs of seconds whose workers are lost and change in number, for tests of what starts workers again."""
import json
import os
import pathlib
import signal
import socket
import subprocess
import time

from tiny_run import config_text

LIMIT_S = 300  # of one condition: some minutes on a machine with other work

STEPS_PER_WORKER = 32  # in an update
WITHOUT_END = 100_000_000


def free_port():
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


class Run:
    """The config and the folder of one run."""

    def __init__(self, folder, earshot, steps=WITHOUT_END, seed=3):
        self.folder, self.earshot, self.seed = pathlib.Path(folder), earshot, seed
        self.config, self.keys, self.out = self.folder / "run.yaml", self.folder / "keys", self.folder / "train"
        self.log = self.folder / "output.log"
        self.set_steps(steps)
        for command in (["dataset", "episodes", "--config", str(self.config)], ["keys", str(self.keys)]):
            done = subprocess.run([earshot, *command], capture_output=True, text=True)
            assert done.returncode == 0, done.stderr

    def set_steps(self, steps):
        self.config.write_text(config_text(self.folder, name="elastic", seed=self.seed, envs_per_worker=2, rollout_steps=16,
                                           checkpoint_every=1000, total_steps=steps, out=self.out))

    def points(self):
        """Points of the curve, oldest first: update, env_steps, workers, and the curves."""
        events = self.out / "events.jsonl"
        points = []
        for line in events.read_text().splitlines() if events.exists() else []:
            try:
                point = json.loads(line)
            except json.JSONDecodeError:  # under way
                break
            values = point["values"]
            points.append({"update": point["update"], "env_steps": point["env_steps"], "values": values,
                           "workers": sum(key.startswith("workers/") and key.endswith("/update_s") for key in values)})
        return points

    def newest(self):
        points = self.points()
        return points[-1] if points else {"update": 0, "env_steps": 0, "workers": 0}

    def wait(self, condition, why, look=lambda: None):
        end = time.monotonic() + LIMIT_S
        while not condition():
            assert time.monotonic() < end, f"{why}: not within {LIMIT_S} s\n{self.said()}"
            look()
            time.sleep(0.05)

    def wait_for(self, workers, updates=4, look=lambda: None):
        """Until so many updates of this number of workers are made."""
        count = lambda: len([point for point in self.points() if point["workers"] == workers])
        self.wait(lambda: count() >= updates and self.newest()["workers"] == workers, f"{updates} updates of {workers} workers", look)

    def end_soon(self, workers, updates=20):
        """The run, once started again, ends after about so many updates of so many workers."""
        self.set_steps(self.newest()["env_steps"] + updates * workers * STEPS_PER_WORKER)

    def workers(self):
        """Process ids of the workers by rank as the launcher numbers them."""
        found = {}
        for process in pathlib.Path("/proc").iterdir():
            try:
                if not process.name.isdigit() or not "earshot_training" in os.readlink(process / "exe"):
                    continue
                if str(self.config) not in (process / "cmdline").read_text().split("\0"):
                    continue
                variables = dict(entry.split("=", 1) for entry in (process / "environ").read_text().split("\0") if "=" in entry)
            except (OSError, UnicodeDecodeError):  # it has ended
                continue
            for name in ("RANK", "OMPI_COMM_WORLD_RANK", "SLURM_PROCID"):
                if name in variables:
                    found[int(variables[name])] = int(process.name)
                    break
        return found

    def kill_worker(self):
        """The highest rank, without a chance to say so."""
        workers = self.workers()
        assert workers, f"no worker is there\n{self.said()}"
        os.kill(workers[max(workers)], signal.SIGKILL)

    def said(self):
        return self.log.read_text()[-6000:] if self.log.exists() else "no output"

    def check_curve(self, numbers):
        """Every update is there once, and the numbers of workers follow each other in this order."""
        points = self.points()
        assert [point["update"] for point in points] == list(range(1, len(points) + 1)), "an update is missing or was reported twice"
        steps = 0
        for point in points:
            steps += point["workers"] * STEPS_PER_WORKER
            assert point["env_steps"] == steps, f"update {point['update']}: {point['env_steps']} steps instead of {steps}"
        phases = []
        for point in points:
            if not phases or phases[-1] != point["workers"]:
                phases.append(point["workers"])
        rest = iter(phases)
        assert all(number in rest for number in numbers) and phases[-1] == numbers[-1], f"numbers of workers: {phases}"
        return points
