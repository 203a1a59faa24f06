#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""real_faults.py EARSHOT [--runs N] [--faults N] [--seed S] [--jobs J] [--ranks N] [--within S] [--schedule FILE] [--record FOLDER]
[--json FILE] [--seconds S]

Training runs of 2 to 8 workers, each on a host of its own (host_switch.py) with network.on_loss=continue, that faults befall one after
another at random moments: processes are killed, stopped and paused, links cut, delayed and lossy.  After each fault the run must go on
within 2 s (--within) and the time of one update, with the workers that are left and the same bits on all (the run itself compares them,
and ends if they differ); or end with exit code 3 and a checkpoint that can be resumed.  Every worker must end, with a documented code.
Prints a table by kind of fault, and of the stages between faults.

On a machine so busy that this script itself is kept waiting, workers count as lost that nothing has befallen.  A run that fails is
counted, but not judged, if that happened between one second before the fault and the failure.  Exit codes, errors of the protocol and
checkpoints that cannot be resumed are judged all the same.

Run number N of seed S is played again by `--seed S+N --runs 1`.  --record writes the schedule of each run, as
tests/support/simulation/fault_schedule.h has it, with the fault `kill_at_end` besides; --schedule plays such a file with --ranks workers.
Exit status: 0, 1 if a run broke the rule, 77 where hosts cannot be made or no run was judged (skipped).
"""

import argparse
import concurrent.futures
import json
import math
import pathlib
import random
import signal
import statistics
import subprocess
import sys
import threading
import time
from types import FrameType
from typing import Any

import host_switch
from fault_run import HOSTS_PREFIX, Broken, Lateness, NotJudged, Run, Wrong
from fault_schedule import Fault, read_schedule

GOES_ON_WITHIN_S = 2.0
STAGES = ("start", "undisturbed", "end", "resume")


def judged(run: Run, lateness: Lateness) -> tuple[str, str]:
    """Outcome of a run as it is played, and why: "kept", "broken" or "not judged"."""
    try:
        try:
            run.play()
        except Broken:
            run.check_words()
            raise
    except Broken as error:
        if run.hosts is not None and run.hosts.failure:
            return "not judged", run.hosts.failure
        late_s = lateness.worst_s(run.row_began - 1)
        return ("not judged", f"this script was kept waiting for {late_s:.1f} s: {error}") if late_s > 0 else ("broken", str(error))
    except NotJudged as reason:
        return "not judged", str(reason)
    except (Wrong, subprocess.SubprocessError, OSError, ValueError, LookupError) as error:
        return "broken", str(error) if isinstance(error, Wrong) else repr(error)
    return "kept", ""


class Runs:
    """Plays runs in several threads, and keeps what came of them."""

    def __init__(self, options: argparse.Namespace, schedule: list[Fault], lateness: Lateness) -> None:
        self.options, self.schedule, self.lateness = options, schedule, lateness
        self.rows: list[dict[str, Any]] = []
        self.count = {"kept": 0, "broken": 0, "not judged": 0}
        self.reasons: list[str] = []
        self.lock = threading.Lock()
        self.playing: set[Run] = set()
        self.is_halted = False
        self.began = time.monotonic()

    def play(self, seed: int) -> None:
        options = self.options
        world = options.ranks or random.Random(f"world {seed}").randint(2, 8)
        with self.lock:
            if self.is_halted or time.monotonic() - self.began > options.seconds:
                return
            run = Run(options.earshot, seed, world, [Fault(**vars(fault)) for fault in self.schedule], options.faults, options.within)
            self.playing.add(run)
        try:
            outcome, why = judged(run, self.lateness)
            if outcome != "kept":
                run.rows[-1]["outcome"] = outcome
            report = f"{outcome}: seed {seed}, {run.rows[-1]['kind']}: {why}\n{run.schedule_text()}{run.said()}"
        finally:
            run.close()
            with self.lock:
                self.playing.discard(run)
        with self.lock:
            if not self.is_halted:
                self.keep(run, outcome, why, report)

    def keep(self, run: Run, outcome: str, why: str, report: str) -> None:
        self.count[outcome] += 1
        self.rows.extend(run.rows)
        if outcome != "kept":
            self.reasons += [why] if outcome == "not judged" else []
            print(report, file=sys.stderr, flush=True)
        if self.options.record:
            pathlib.Path(self.options.record, f"faults{run.seed}.txt").write_text(run.schedule_text())
        if self.options.json:
            with open(self.options.json, "a") as file:
                file.writelines(json.dumps(row) + "\n" for row in run.rows)

    def halt(self) -> None:
        with self.lock:
            self.is_halted = True
            for run in self.playing:
                run.halt()


def print_table(rows: list[dict[str, Any]]) -> None:
    columns = ("went on", 9), ("ended", 7), ("broken", 8), ("not judged", 12)
    print(f"{'fault':<28}{'number':>7}" + "".join(f"{name:>{width}}" for name, width in columns)
          + f"{'median s':>10}{'95 % s':>8}{'most s':>8}{'over 2 s':>10}")
    faults = [row for row in rows if row["fault"]]
    groups = {kind: [row for row in faults if row["kind"] == kind] for kind in sorted({row["kind"] for row in faults})}
    groups["all"] = faults
    groups |= {stage: [row for row in rows if row["kind"] == stage and not row["fault"]] for stage in STAGES}
    for kind, group in groups.items():
        outcomes = [row["outcome"] for row in group]
        pauses = sorted(row["pause_s"] for row in group if row["outcome"] == "went on" and row["fault"])
        times = [statistics.median(pauses), pauses[math.ceil(0.95 * len(pauses)) - 1], pauses[-1]] if pauses else [0.0] * 3
        print(f"{kind:<28}{len(group):>7}" + "".join(f"{outcomes.count(name):>{width}}" for name, width in columns)
              + f"{times[0]:>10.2f}{times[1]:>8.2f}{times[2]:>8.2f}{sum(pause > GOES_ON_WITHIN_S for pause in pauses):>10}")
    print("faults by workers: " + ", ".join(f"{world}: {sum(row['members'] == world for row in faults)}" for world in range(2, 9)))


def end_by_signal(number: int, _: FrameType | None) -> None:
    raise SystemExit(128 + number)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("earshot")
    for name, default in (("runs", 20), ("faults", 8), ("seed", 1), ("jobs", 1), ("ranks", 0)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--seconds", type=float, default=1e9, help="begin no run after so long")
    parser.add_argument("--within", type=float, default=GOES_ON_WITHIN_S, help="seconds in which a run must go on")
    for name in ("schedule", "record", "json"):
        parser.add_argument(f"--{name}")
    options = parser.parse_args()
    options.earshot = str(pathlib.Path(options.earshot).resolve())
    try:
        schedule = read_schedule(options.schedule) if options.schedule else []
    except (OSError, ValueError) as error:
        parser.error(str(error))
    if reason := host_switch.missing():
        print(f"skipped: {reason}")
        return 77
    host_switch.delete_hosts_of_the_dead(HOSTS_PREFIX)
    signal.signal(signal.SIGTERM, end_by_signal)
    with Lateness() as lateness:
        runs = Runs(options, schedule, lateness)
        with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
            try:
                list(pool.map(runs.play, range(options.seed, options.seed + options.runs)))
            except BaseException:
                runs.halt()
                raise
    print_table(runs.rows)
    print(f"{sum(bool(row['fault']) for row in runs.rows)} faults in {sum(runs.count.values())} runs; "
          f"{runs.count['broken']} runs broke the rule, {runs.count['not judged']} were not judged")
    if runs.count["broken"]:
        return 1
    if not runs.count["kept"]:
        print(f"skipped: no run was judged: {runs.reasons[0] if runs.reasons else 'none was begun'}")
        return 77
    return 0


if __name__ == "__main__":
    sys.exit(main())
