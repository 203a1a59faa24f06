#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""real_faults.py EARSHOT [--runs N] [--faults N] [--seed S] [--jobs J] [--ranks N] [--schedule FILE] [--record FOLDER] [--json FILE] [--seconds S]

Training runs of 2 to 8 workers, each on a host of its own (host_switch.py) with network.on_loss=continue, that faults befall one after another at
random moments: processes are killed, stopped and paused, links cut, delayed and lossy.  After each fault the run must go on within 2 s and the time of
one update, with the workers that are left and the same bits on all (the run itself compares them, and ends if they differ); or end with exit code 3
and a checkpoint that can be resumed.  Every worker must end, with a documented code.  Prints a table by kind of fault.  On a machine so busy that
this script itself is kept waiting, workers count as lost that nothing has befallen: such runs are counted, but not judged.

Run number N of seed S is played again by `--seed S+N --runs 1`.  --record writes the schedule of each run, as tests/support/simulation/fault_schedule.h
has it, with the fault `kill_at_end` besides; --schedule plays such a file with --ranks workers.  Exit status: 0, 1 if a run broke the rule, 77 where
hosts cannot be made (skipped).
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable

import host_switch
from fault_schedule import Fault, draw_fault, has_quorum, may_be_left, read_schedule
from tiny_run import config_text

GOES_ON_WITHIN_S = 2.0
DEADLINE_S = 60.0  # of what has no bound of its own, on a machine with other work
WITHOUT_END = 100_000_000
LOST, DONE, ENDED = 3, 0, 143  # exit codes
MISUNDERSTOOD = ("different weights", "breaks the protocol", "internal error", "too far apart", "is expected", "Assertion")


class Broken(Exception):
    """A run that does not keep the rule."""


class Lateness:
    """How long this process has been kept from running."""

    STEP_S, MOST_S = 0.01, 0.3  # a worker counts as stopped after 0.6 s without running

    def __init__(self) -> None:
        self.late: list[tuple[float, float]] = []
        threading.Thread(target=self.watch, daemon=True).start()

    def watch(self) -> None:
        last = time.monotonic()
        while True:
            time.sleep(self.STEP_S)
            now = time.monotonic()
            if now - last > self.MOST_S:
                self.late.append((now, now - last))
            last = now

    def worst_s(self, since: float) -> float:
        return max((seconds for at, seconds in self.late if at >= since), default=0.0)


LATENESS = Lateness()


class Run:
    """One run of `world` workers under faults."""

    def __init__(self, earshot: str, seed: int, world: int, schedule: list[Fault], most_faults: int) -> None:
        self.earshot, self.seed, self.world = earshot, seed, world
        self.schedule, self.most_faults = schedule, most_faults
        self.draw = random.Random(f"faults {seed}")
        self.played: list[Fault] = []
        self.results: list[dict[str, object]] = []
        self.temporary = tempfile.TemporaryDirectory(prefix="real_faults_")
        self.folder = pathlib.Path(self.temporary.name)
        self.config, self.keys, self.out = self.folder / "run.yaml", self.folder / "keys", self.folder / "train"
        self.config.write_text(config_text(self.folder, name="faults", seed=seed, envs_per_worker=2, rollout_steps=4, checkpoint_every=1000,
                                           total_steps=WITHOUT_END, out=self.out))
        for command in (["dataset", "episodes", "--config", str(self.config)], ["keys", str(self.keys)]):
            self.call(command)
        self.hosts = host_switch.HostSwitch(world, f"earshot{os.getpid()}-{seed}", seed)
        self.members = set(range(world))
        self.workers: list[subprocess.Popen[bytes]] = []
        self.killed: set[int] = set()
        self.timers: list[threading.Timer] = []
        self.bytes_read, self.longest_update_s = 0, 0.0

    def call(self, command: list[str]) -> str:
        done = subprocess.run([self.earshot, *command], capture_output=True, text=True, check=False, timeout=2 * DEADLINE_S)
        if done.returncode != 0:
            raise Broken(f"{' '.join(command)}: code {done.returncode}: {done.stderr[-1000:]}")
        return done.stdout

    def start(self) -> None:
        for rank in range(self.world):
            variables = {"EARSHOT_RANK": rank, "EARSHOT_WORLD_SIZE": self.world, "EARSHOT_RUN_ID": f"faults{self.seed}",
                         "EARSHOT_RENDEZVOUS": f"tcp://{self.hosts.address(0)}:29500"}
            command = self.hosts.on(rank, [self.earshot, "train", str(self.config), f"network.curve_key_file={self.keys}", "network.on_loss=continue"])
            with self.log(rank).open("wb") as log:
                self.workers.append(subprocess.Popen(command, env={**os.environ, **{key: str(value) for key, value in variables.items()}}, stdout=log,
                                                     stderr=log, stdin=subprocess.DEVNULL))

    def log(self, rank: int) -> pathlib.Path:
        return self.folder / f"log{rank}"

    def new_members(self) -> list[set[int]]:
        """Workers of the updates that have been reported since the last look."""
        events = self.out / "events.jsonl"
        if not events.exists() or events.stat().st_size == self.bytes_read:
            return []
        with events.open("rb") as file:
            file.seek(self.bytes_read)
            lines = file.read().rpartition(b"\n")[0]
        self.bytes_read += len(lines) + 1 if lines else 0
        return [{int(key.split("/")[1]) for key in json.loads(line)["values"] if key.startswith("workers/") and key.endswith("/update_s")}
                for line in lines.splitlines()]

    def wait_for_updates(self, count: int, accepted: list[set[int]], limit_s: float) -> set[int] | None:
        """Until so many updates of one of these sets of workers have been reported; none if all workers have ended before."""
        end, seen = time.monotonic() + limit_s, 0
        while True:
            for members in self.new_members():
                seen += members in accepted
                if seen >= count:
                    return members
            if all(worker.poll() is not None for worker in self.workers):
                return None
            if time.monotonic() > end:
                raise Broken(f"no update of {accepted} within {limit_s:.0f} s")
            time.sleep(0.01)

    def measure_update(self) -> None:
        """Two updates without a fault, and how long they take."""
        self.wait_for_updates(1, [self.members], DEADLINE_S)
        began = time.monotonic()
        if self.wait_for_updates(1, [self.members], DEADLINE_S) is not None:
            self.longest_update_s = max(self.longest_update_s, time.monotonic() - began)

    def later(self, seconds: float, action: Callable[[], None]) -> None:
        self.timers.append(threading.Timer(seconds, action))
        self.timers[-1].start()

    def signal(self, rank: int, number: int) -> None:
        if self.workers[rank].poll() is None:
            self.workers[rank].send_signal(number)

    def inflict(self, fault: Fault) -> None:
        if fault.kind in ("kill", "kill_at_end"):
            self.killed.add(fault.rank)
            self.signal(fault.rank, signal.SIGKILL)
        elif fault.kind == "stop":
            self.signal(fault.rank, signal.SIGSTOP)
            self.later(fault.duration_s, lambda: self.signal(fault.rank, signal.SIGCONT))
        elif fault.kind in ("cut", "cut_way"):
            group = {rank for rank in range(self.world) if fault.group >> rank & 1}
            ways = self.hosts.cut(group) if fault.kind == "cut" else self.hosts.cut_way(fault.rank, fault.other)
            self.later(fault.duration_s, lambda: self.hosts.heal(ways))
        else:
            table, value = (self.hosts.delays, (0.5 * fault.amount, 1.5 * fault.amount)) if fault.kind == "delay" else (self.hosts.losses, fault.amount)
            table[fault.rank] = value
            self.later(fault.duration_s, lambda: table.pop(fault.rank, None))

    def suffer(self, fault: Fault) -> bool:
        """The fault, and what must come of it.  False if the run has ended by it."""
        accepted, before = may_be_left(fault, self.members), set(self.members)
        self.new_members()
        began = time.monotonic()
        self.inflict(fault)
        if fault.is_short or fault.kind == "lose":
            time.sleep(fault.duration_s)
            began = time.monotonic()
            self.new_members()
        # The first update after lost frames may have been made before a worker counted as lost.
        left = self.wait_for_updates(2 if fault.kind == "lose" else 1, accepted, DEADLINE_S)
        pause_s = time.monotonic() - began
        if fault.kind == "stop" and accepted == [{fault.rank}]:  # the others have ended, and it begins again when it wakes
            pause_s = max(0.0, pause_s - fault.duration_s)
        outcome = "ended" if left is None else "went on"
        self.results.append({"seed": self.seed, "fault": fault.line(), "kind": fault.label, "members": len(before), "outcome": outcome, "pause_s": pause_s,
                             "update_s": self.longest_update_s})
        if left is None:
            may_end = not accepted or fault.kind in ("cut_way", "lose")
            if not may_end:
                raise Broken(f"{fault.line()} ended the run of {sorted(before)}")
            return False
        if pause_s > GOES_ON_WITHIN_S + self.longest_update_s:
            raise Broken(f"{fault.line()}: the next update of {sorted(left)} came after {pause_s:.2f} s; one took {self.longest_update_s:.2f} s before")
        self.members = left
        return True

    def end(self, fault: Fault | None) -> None:
        """All are asked to end, and end after the same update; with a fault one of them is killed meanwhile."""
        began = time.monotonic()
        for rank in self.members:
            self.signal(rank, signal.SIGTERM)
        if fault is not None:
            time.sleep(fault.duration_s)
            self.inflict(fault)
        codes = {rank: self.wait_for_end(rank) for rank in sorted(self.members - self.killed)}
        rest = set(codes)
        lost_all = fault is not None and not has_quorum(rest, self.members)
        allowed = {ENDED, LOST} if lost_all else {ENDED}
        if fault is not None:
            self.results.append({"seed": self.seed, "fault": fault.line(), "kind": fault.label, "members": len(self.members),
                                 "outcome": "ended", "pause_s": time.monotonic() - began, "update_s": self.longest_update_s})
        if not set(codes.values()) <= allowed:
            raise Broken(f"{fault.line() if fault else 'SIGTERM'} at the end of a run of {sorted(self.members)}: exit codes {codes}")

    def wait_for_end(self, rank: int) -> int:
        try:
            return self.workers[rank].wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            raise Broken(f"worker {rank} has not ended after {DEADLINE_S:.0f} s") from None

    def check_lost(self) -> None:
        """Those that are out have ended, told that they were."""
        for rank in set(range(self.world)) - self.members - self.killed:
            code = self.wait_for_end(rank)
            if code != LOST:
                raise Broken(f"worker {rank}, which is out, ended with code {code}")

    def check_resumes(self) -> None:
        steps = json.loads((self.out / "events.jsonl").read_bytes().splitlines()[-1])["env_steps"]
        target = steps + 8 * self.world
        self.call(["train", str(self.config), "--resume", str(self.out), "--change", "workers", f"total_steps={target}"])
        reached = json.loads((self.out / "events.jsonl").read_bytes().splitlines()[-1])["env_steps"]
        if reached < target:
            raise Broken(f"resumed from {steps} steps, it ended at {reached} instead of {target}")

    def play(self) -> None:
        self.start()
        if self.wait_for_updates(1, [self.members], 2 * DEADLINE_S) is None:
            codes = [worker.returncode for worker in self.workers]
            raise Broken(f"did not start: exit codes {codes}")
        began, last = time.monotonic(), None
        goes_on = True
        while goes_on and last is None and len(self.members) > 1:
            self.measure_update()
            num = len(self.played)
            if self.schedule:
                if num == len(self.schedule):
                    break
                fault = self.schedule[num]
                time.sleep(max(0.0, began + fault.at_s - time.monotonic()))
            else:
                if num == self.most_faults:
                    break
                fault = draw_fault(self.draw, self.members, num == self.most_faults - 1 or len(self.members) == 2)
                time.sleep(self.draw.uniform(0, 2) * min(self.longest_update_s, 0.5))
            fault.at_s = time.monotonic() - began
            self.played.append(fault)
            if fault.kind == "kill_at_end":
                last = fault
            else:
                goes_on = self.suffer(fault)
        if goes_on:
            self.end(last)
            self.check_lost()
        else:
            for rank in set(range(self.world)) - self.killed:
                if self.wait_for_end(rank) != LOST:
                    raise Broken(f"worker {rank} ended with code {self.workers[rank].returncode} in a run that was lost")
        for rank in range(self.world):
            for words in MISUNDERSTOOD:
                if words in self.log(rank).read_text(errors="replace"):
                    raise Broken(f"worker {rank} says: {words}")
        self.check_resumes()

    def schedule_text(self) -> str:
        return f"# {self.world} workers, seed {self.seed}\n" + "".join(fault.line() + "\n" for fault in self.played)

    def said(self) -> str:
        return "".join(f"--- worker {rank}, code {self.workers[rank].poll()}\n{self.log(rank).read_text(errors='replace')[-1500:]}\n"
                       for rank in range(len(self.workers)))

    def close(self) -> None:
        for timer in self.timers:
            timer.cancel()
        for worker in self.workers:
            if worker.poll() is None:
                worker.kill()
            worker.wait()
        self.hosts.close()
        self.temporary.cleanup()


def play_run(options: argparse.Namespace, seed: int) -> tuple[list[dict[str, object]], str]:
    """What came of each fault, and how the run broke the rule."""
    draw = random.Random(f"world {seed}")
    world = options.ranks or draw.randint(2, 8)
    run = Run(options.earshot, seed, world, read_schedule(options.schedule) if options.schedule else [], options.faults)
    problem, began = "", time.monotonic()
    try:
        run.play()
    except (Broken, subprocess.TimeoutExpired, OSError) as error:
        problem = f"seed {seed}: {error}\n{run.schedule_text()}{run.said()}"
        late_s = LATENESS.worst_s(began)
        if run.results:
            run.results[-1]["outcome"] = "not judged" if late_s > 0 else "broken"
        if late_s > 0:
            problem = f"not judged, as this script was kept waiting for {late_s:.1f} s: {problem}"
    finally:
        run.close()
    if options.record:
        pathlib.Path(options.record, f"faults{seed}.txt").write_text(run.schedule_text())
    return run.results, problem


def print_table(results: list[dict[str, object]]) -> None:
    print(f"{'fault':<28}{'number':>7}{'went on':>9}{'ended':>7}{'broken':>8}{'not judged':>12}{'median s':>10}{'95 % s':>8}{'most s':>8}{'over 2 s':>10}")
    for kind in sorted({str(result["kind"]) for result in results}) + ["all"]:
        rows = [result for result in results if kind in (result["kind"], "all")]
        pauses = sorted(float(str(row["pause_s"])) for row in rows if row["outcome"] == "went on")
        count = lambda outcome: sum(row["outcome"] == outcome for row in rows)  # noqa: B023
        times = [statistics.median(pauses), pauses[int(0.95 * (len(pauses) - 1))], pauses[-1]] if pauses else [0.0] * 3
        print(f"{kind:<28}{len(rows):>7}{count('went on'):>9}{count('ended'):>7}{count('broken'):>8}{count('not judged'):>12}"
              f"{times[0]:>10.2f}{times[1]:>8.2f}{times[2]:>8.2f}{sum(pause > GOES_ON_WITHIN_S for pause in pauses):>10}")
    print("by workers: " + ", ".join(f"{world}: {sum(row['members'] == world for row in results)}" for world in range(2, 9)))


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("earshot")
    for name, default in (("runs", 20), ("faults", 8), ("seed", 1), ("jobs", 1), ("ranks", 0)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--seconds", type=float, default=1e9, help="begin no run after so long")
    for name in ("schedule", "record", "json"):
        parser.add_argument(f"--{name}")
    options = parser.parse_args()
    options.earshot = str(pathlib.Path(options.earshot).resolve())
    if reason := host_switch.missing():
        print(f"skipped: {reason}")
        return 77
    results: list[dict[str, object]] = []
    broken, not_judged, played, began, lock = 0, 0, 0, time.monotonic(), threading.Lock()

    def one(seed: int) -> None:
        nonlocal broken, not_judged, played
        if time.monotonic() - began > options.seconds:
            return
        of_run, problem = play_run(options, seed)
        with lock:
            played += 1
            results.extend(of_run)
            if problem:
                judged = not problem.startswith("not judged")
                broken, not_judged = broken + judged, not_judged + (not judged)
                print(f"{'BROKEN ' if judged else ''}{problem}", file=sys.stderr, flush=True)
            if options.json:
                with open(options.json, "a") as file:
                    file.writelines(json.dumps(result) + "\n" for result in of_run)

    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        list(pool.map(one, range(options.seed, options.seed + options.runs)))
    print_table(results)
    print(f"{len(results)} faults in {played} runs; {broken} runs broke the rule, {not_judged} were not judged")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
