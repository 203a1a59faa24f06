# SPDX-License-Identifier: Apache-2.0
"""One run of real_faults.py: workers on hosts of their own (host_switch.py), what befalls them, and whether they keep the rule."""

import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from typing import Any

import host_switch
from fault_schedule import Fault, draw_fault, has_quorum, may_be_left
from tiny_run import config_text

HOSTS_PREFIX = "faults"  # of the names of namespaces
DEADLINE_S = 60.0  # of what has no bound of its own, on a machine with other work
WITHOUT_END = 100_000_000
FAILED, LOST, ENDED = 1, 3, 143  # exit codes
MISUNDERSTOOD = ("different weights", "breaks the protocol", "internal error", "too far apart", "is expected", "Assertion")


class Broken(Exception):
    """A run that does not keep the rule.  On a machine that kept workers from running, the machine may be why."""


class Wrong(Exception):
    """A run that broke the rule in a way that no slow machine explains: exit codes, errors of the protocol, checkpoints."""


class NotJudged(Exception):
    """The hosts failed, not the run."""


class Lateness:
    """How long this process has been kept from running, while it is entered."""

    STEP_S, MOST_S = 0.01, 0.3  # a worker counts as stopped after 0.6 s without running

    def __init__(self) -> None:
        self.late: list[tuple[float, float]] = []
        self.last = time.monotonic()
        self.is_over = threading.Event()
        self.thread = threading.Thread(target=self.watch, daemon=True)

    def __enter__(self) -> "Lateness":
        self.last = time.monotonic()
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.is_over.set()
        self.thread.join()

    def watch(self) -> None:
        while not self.is_over.wait(self.STEP_S):
            now = time.monotonic()
            if now - self.last > self.MOST_S:
                self.late.append((now, now - self.last))
            self.last = now

    def worst_s(self, since: float) -> float:
        """Longest stall that ended after that moment, or has not ended; 0 if none was over MOST_S."""
        stalls = [seconds for at, seconds in self.late if at >= since] + [time.monotonic() - self.last]
        return max((seconds for seconds in stalls if seconds > self.MOST_S), default=0.0)


class Run:
    """One run of `world` workers under faults, which halt() ends from another thread.

    `rows` has what came of each fault, and of the stages between them (start, undisturbed, end, resume), whose "fault" is empty.
    The outcome of a row is "open" until it is known."""

    def __init__(self, earshot: str, seed: int, world: int, schedule: list[Fault], most_faults: int, within_s: float) -> None:
        self.earshot, self.seed, self.world, self.within_s = earshot, seed, world, within_s
        self.schedule, self.most_faults = schedule, most_faults
        self.draw = random.Random(f"faults {seed}")
        self.played: list[Fault] = []
        self.rows: list[dict[str, Any]] = []
        self.row_began = time.monotonic()
        self.temporary = tempfile.TemporaryDirectory(prefix="real_faults_")
        self.folder = pathlib.Path(self.temporary.name)
        self.config, self.keys, self.out = self.folder / "run.yaml", self.folder / "keys", self.folder / "train"
        self.hosts: host_switch.HostSwitch | None = None
        self.members = set(range(world))
        self.workers: list[subprocess.Popen[bytes]] = []
        self.called: subprocess.Popen[str] | None = None
        self.is_halted = threading.Event()
        self.killed: set[int] = set()
        self.timers: list[threading.Timer] = []
        self.bytes_read, self.longest_update_s = 0, 0.0

    def begin(self, kind: str, fault: Fault | None = None) -> dict[str, Any]:
        self.rows.append({"seed": self.seed, "fault": fault.line() if fault else "", "kind": fault.label if fault else kind,
                          "members": len(self.members), "outcome": "open", "pause_s": 0.0, "update_s": self.longest_update_s})
        self.row_began = time.monotonic()
        return self.rows[-1]

    def call(self, command: list[str]) -> None:
        self.called = subprocess.Popen([self.earshot, *command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            if self.is_halted.is_set():
                raise NotJudged("halted")
            error = self.called.communicate(timeout=2 * DEADLINE_S)[1]
        except subprocess.TimeoutExpired:
            raise Broken(f"{' '.join(command)}: not done after {2 * DEADLINE_S:.0f} s") from None
        finally:
            if self.called.poll() is None:
                self.called.kill()
                self.called.communicate()
        if self.called.returncode != 0:
            raise Wrong(f"{' '.join(command)}: code {self.called.returncode}: {error[-1000:]}")

    def prepare(self) -> None:
        self.config.write_text(config_text(self.folder, name="faults", seed=self.seed, envs_per_worker=2, rollout_steps=4,
                                           checkpoint_every=1000, total_steps=WITHOUT_END, out=self.out))
        for command in (["dataset", "episodes", "--config", str(self.config)], ["keys", str(self.keys)]):
            self.call(command)
        try:
            self.hosts = host_switch.HostSwitch(self.world, f"{HOSTS_PREFIX}{os.getpid()}-{self.seed}", self.seed)
        except (OSError, subprocess.SubprocessError) as error:
            raise NotJudged(f"hosts cannot be made: {error}") from error

    def start(self, hosts: host_switch.HostSwitch) -> None:
        for rank in range(self.world):
            variables = {"EARSHOT_RANK": rank, "EARSHOT_WORLD_SIZE": self.world, "EARSHOT_RUN_ID": f"faults{self.seed}",
                         "EARSHOT_RENDEZVOUS": f"tcp://{hosts.address(0)}:29500"}
            command = hosts.on(rank, [self.earshot, "train", str(self.config), f"network.curve_key_file={self.keys}",
                                      "network.on_loss=continue"])
            if shutil.which("setpriv"):  # no worker outlives this script, whatever ends it
                command = ["setpriv", "--pdeathsig", "KILL", *command]
            environment = {**os.environ, **{key: str(value) for key, value in variables.items()}}
            with self.log(rank).open("wb") as log:
                self.workers.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log, stdin=subprocess.DEVNULL))
            if self.is_halted.is_set():
                self.halt()

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

    def look(self, accepted: list[set[int]]) -> list[set[int]]:
        """Those of the updates since the last look that are by accepted workers.  The others must be by the workers of before."""
        updates = self.new_members()
        for members in updates:
            if members not in accepted and members != self.members:
                raise Broken(f"an update by {sorted(members)}; {sorted(self.members)} made those before, {accepted} may go on")
        return [members for members in updates if members in accepted]

    def wait_for_updates(self, count: int, accepted: list[set[int]], limit_s: float) -> set[int] | None:
        """Until so many updates of one of these sets of workers have been reported; none if all workers have ended before."""
        end, seen = time.monotonic() + limit_s, 0
        while True:
            have_ended = all(worker.poll() is not None for worker in self.workers)
            found = self.look(accepted)
            seen += len(found)
            if found and seen >= count:
                return found[-1]
            if have_ended:
                return None
            if self.hosts is None or self.hosts.failure:
                raise NotJudged(self.hosts.failure if self.hosts else "no hosts")
            if time.monotonic() > end:
                raise Broken(f"no update of {accepted} within {limit_s:.0f} s")
            time.sleep(0.01)

    def measure_update(self) -> None:
        """Two updates without a fault, and how long they take."""
        row = self.begin("undisturbed")
        for is_second in (False, True):
            began = time.monotonic()
            if self.wait_for_updates(1, [self.members], DEADLINE_S) is None:
                raise Broken(f"the run of {sorted(self.members)} ended without a fault")
            if is_second:
                self.longest_update_s = max(self.longest_update_s, time.monotonic() - began)
        row["outcome"] = "went on"

    def later(self, seconds: float, action: Callable[[], None]) -> None:
        self.timers.append(threading.Timer(seconds, action))
        self.timers[-1].start()

    def signal(self, rank: int, number: int) -> None:
        if self.workers[rank].poll() is None:
            self.workers[rank].send_signal(number)

    def inflict(self, fault: Fault, hosts: host_switch.HostSwitch) -> None:
        if fault.kind in ("kill", "kill_at_end"):
            self.killed.add(fault.rank)
            self.signal(fault.rank, signal.SIGKILL)
        elif fault.kind == "stop":
            self.signal(fault.rank, signal.SIGSTOP)
            self.later(fault.duration_s, lambda: self.signal(fault.rank, signal.SIGCONT))
        elif fault.kind in ("cut", "cut_way"):
            group = {rank for rank in range(self.world) if fault.group >> rank & 1}
            ways = hosts.cut(group) if fault.kind == "cut" else hosts.cut_way(fault.rank, fault.other)
            self.later(fault.duration_s, lambda: hosts.heal(ways))
        elif fault.kind == "delay":
            hosts.delays[fault.rank] = (0.5 * fault.amount, 1.5 * fault.amount)
            self.later(fault.duration_s, lambda: hosts.delays.pop(fault.rank, None))
        else:
            hosts.losses[fault.rank] = fault.amount
            self.later(fault.duration_s, lambda: hosts.losses.pop(fault.rank, None))

    def suffer(self, fault: Fault, hosts: host_switch.HostSwitch) -> bool:
        """The fault, and what must come of it.  False if the run has ended by it."""
        accepted, before = may_be_left(fault, self.members), set(self.members)
        row = self.begin("", fault)
        self.look([self.members])
        began = time.monotonic()
        self.inflict(fault, hosts)
        if fault.is_short or fault.kind == "lose":
            self.is_halted.wait(fault.duration_s)
            began = time.monotonic()
            self.look(accepted)
        # The first update after lost frames may have been made before a worker counted as lost.
        left = self.wait_for_updates(2 if fault.kind == "lose" else 1, accepted, DEADLINE_S)
        pause_s = time.monotonic() - began
        if fault.kind == "stop" and accepted == [{fault.rank}]:  # the others have ended, and it begins again when it wakes
            pause_s = max(0.0, pause_s - fault.duration_s)
        row["pause_s"] = pause_s
        if left is None:
            may_end = not accepted or fault.kind in ("cut_way", "lose")
            if not may_end:
                raise Broken(f"{fault.line()} ended the run of {sorted(before)}")
            row["outcome"] = "ended"
            return False
        if pause_s > self.within_s + self.longest_update_s:
            raise Broken(f"{fault.line()}: the next update of {sorted(left)} came after {pause_s:.2f} s; "
                         f"one took {self.longest_update_s:.2f} s before")
        row["outcome"] = "went on"
        self.members = left
        return True

    def end(self, fault: Fault | None, hosts: host_switch.HostSwitch) -> None:
        """All are asked to end, and end after the same update; with a fault one of them is killed meanwhile."""
        row = self.begin("end", fault)
        for rank in self.members:
            self.signal(rank, signal.SIGTERM)
        if fault is not None:
            self.is_halted.wait(fault.duration_s)
            self.inflict(fault, hosts)
        codes = {rank: self.wait_for_end(rank) for rank in sorted(self.members - self.killed)}
        row["pause_s"] = time.monotonic() - self.row_began
        lost_all = fault is not None and not has_quorum(set(codes), self.members)
        allowed = {ENDED, LOST} if lost_all else {ENDED}
        if not set(codes.values()) <= allowed:
            raise Broken(f"{fault.line() if fault else 'SIGTERM'} at the end of a run of {sorted(self.members)}: exit codes {codes}")
        row["outcome"] = "ended"

    def wait_for_end(self, rank: int) -> int:
        try:
            return self.workers[rank].wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            raise Broken(f"worker {rank} has not ended after {DEADLINE_S:.0f} s") from None

    def check_out(self, ranks: set[int]) -> None:
        """Those that are out have ended, told that they were."""
        for rank in sorted(ranks - self.killed):
            code = self.wait_for_end(rank)
            if code != LOST:
                raise Wrong(f"worker {rank}, which is out, ended with code {code}")

    def check_words(self) -> None:
        """No worker has ended with a code that no loss explains, or says what only a defect makes it say."""
        codes = {None, LOST, ENDED}
        if self.rows[-1]["kind"] == "start":  # a loss before the first update ends the run as an error
            codes.add(FAILED)
        for rank, worker in enumerate(self.workers):
            code = worker.poll()
            if code not in codes and rank not in self.killed:
                raise Wrong(f"worker {rank} ended with code {code}")
            for words in MISUNDERSTOOD:
                if words in self.log(rank).read_text(errors="replace"):
                    raise Wrong(f"worker {rank} says: {words}")

    def check_resumes(self) -> None:
        steps = self.steps_of_last_update()
        target = steps + 8 * self.world
        self.call(["train", str(self.config), "--resume", str(self.out), "--change", "workers", f"total_steps={target}"])
        reached = self.steps_of_last_update()
        if reached < target:
            raise Wrong(f"resumed from {steps} steps, it ended at {reached} instead of {target}")

    def steps_of_last_update(self) -> int:
        return int(json.loads((self.out / "events.jsonl").read_bytes().splitlines()[-1])["env_steps"])

    def next_fault(self, began: float) -> Fault | None:
        """After the pause before it; none at the end of the schedule."""
        num = len(self.played)
        if num == (len(self.schedule) if self.schedule else self.most_faults):
            return None
        if self.schedule:
            fault = self.schedule[num]
            self.is_halted.wait(max(0.0, began + fault.at_s - time.monotonic()))
        else:
            fault = draw_fault(self.draw, self.members, num == self.most_faults - 1 or len(self.members) == 2)
            self.is_halted.wait(self.draw.uniform(0, 2) * min(self.longest_update_s, 0.5))
        fault.at_s = time.monotonic() - began
        self.played.append(fault)
        return fault

    def play(self) -> None:
        row = self.begin("start")
        self.prepare()
        assert self.hosts is not None
        self.start(self.hosts)
        if self.wait_for_updates(1, [self.members], 2 * DEADLINE_S) is None:
            raise Broken(f"did not start: exit codes {[worker.returncode for worker in self.workers]}")
        row["outcome"] = "went on"
        began, goes_on = time.monotonic(), True
        last: Fault | None = None
        while goes_on and last is None and len(self.members) > 1:
            self.measure_update()
            fault = self.next_fault(began)
            if fault is None:
                break
            if fault.kind == "kill_at_end":
                last = fault
            else:
                goes_on = self.suffer(fault, self.hosts)
        if goes_on:
            self.end(last, self.hosts)
        row = self.begin("end") if last is not None or not goes_on else self.rows[-1]
        row["outcome"] = "open"
        self.check_out(set(range(self.world)) - (self.members if goes_on else set()))
        self.check_words()
        row["outcome"] = "ended"
        row = self.begin("resume")
        self.check_resumes()
        row["outcome"] = "went on"

    def schedule_text(self) -> str:
        return f"# {self.world} workers, seed {self.seed}\n" + "".join(fault.line() + "\n" for fault in self.played)

    def said(self) -> str:
        return "".join(f"--- worker {rank}, code {self.workers[rank].poll()}\n{self.log(rank).read_text(errors='replace')[-1500:]}\n"
                       for rank in range(len(self.workers)))

    def halt(self) -> None:
        """Kills all processes.  play() then ends with an error."""
        self.is_halted.set()
        for process in [*self.workers, *([self.called] if self.called else [])]:
            if process.poll() is None:
                process.kill()

    def close(self) -> None:
        for timer in self.timers:
            timer.cancel()
        self.halt()
        for worker in self.workers:
            worker.wait()
        if self.hosts is not None:
            self.hosts.close()
        self.temporary.cleanup()
