#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""run_ends_test.py EARSHOT [TRIES] [SEED]: ends training runs by faults at random moments, on 1 to 4 workers, and prints a table by kind of
fault.  Each run must end with its documented exit code and a checkpoint of its last whole update, from which one more update can be trained;
or go on.  TRIES (default 200) are shared evenly among kinds and numbers of workers.  Exit status: 0, or 1 if any run broke the rule."""

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tiny_run import config_text

PROGRAM = str(Path(sys.argv[1]).resolve())
TRIES = int(sys.argv[2]) if len(sys.argv) > 2 else 200
SEED = int(sys.argv[3]) if len(sys.argv) > 3 else 35
DEADLINE_S = 120.0

STEPS_PER_UPDATE = 8  # of one worker
NOBODY = 65534
ENDLESS = "total_steps=10000000"


class Broken(Exception):
    """A run that does not keep the rule."""


def expect(holds: bool, what: str) -> None:
    if not holds:
        raise Broken(what)


class Run:
    """One run in a folder of its own, in a process group of its own."""

    def __init__(self, draw: random.Random, workers: int, checkpoint_every: int = 1000) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="run_ends_"))
        self.draw, self.workers = draw, workers
        self.out = self.folder / "run"
        self.log = self.folder / "log"
        self.config = self.folder / "tiny.yaml"
        self.config.write_text(config_text(self.folder, name="tiny", seed=3, envs_per_worker=2, rollout_steps=4,
                                           checkpoint_every=checkpoint_every, keep=2, total_steps=32, eval_envs=2, out=self.out))
        self.process: subprocess.Popen[bytes] | None = None

    def words(self, *more: str) -> list[str]:
        return [PROGRAM, "train", str(self.config), "--workers", str(self.workers), *more]

    def start(self, command: list[str]) -> None:
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True)

    def started(self) -> subprocess.Popen[bytes]:
        assert self.process is not None
        return self.process

    def logged(self) -> int:
        """Updates of which the run has told."""
        events = self.out / "events.jsonl"
        return events.read_bytes().count(b"\n") if events.exists() else 0

    def wait_for_updates(self, count: int) -> None:
        end = time.monotonic() + DEADLINE_S
        while self.logged() < count:
            expect(self.started().poll() is None, f"ended before update {count}: {self.text()}")
            expect(time.monotonic() < end, f"no update {count} within {DEADLINE_S:.0f} s")
            time.sleep(0.002)
        time.sleep(self.draw.uniform(0, 0.05))

    def end(self) -> int:
        try:
            code = self.started().wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            os.killpg(self.started().pid, signal.SIGKILL)
            raise Broken(f"has not ended within {DEADLINE_S:.0f} s") from None
        return code if code >= 0 else 128 - code

    def text(self) -> str:
        return self.log.read_text(errors="replace")

    def saved(self) -> int:
        """Update of the newest whole checkpoint."""
        done = subprocess.run([PROGRAM, "policy", str(self.out), "--json", str(self.folder / "saved.json")], capture_output=True, text=True,
                              check=False, timeout=DEADLINE_S)
        expect(done.returncode == 0, f"has no whole checkpoint: {done.stderr}")
        match = re.search(r"(\d+) steps", done.stdout)
        expect(match is not None, f"no steps in: {done.stdout}")
        return int(match.group(1)) // (STEPS_PER_UPDATE * self.workers) if match else 0

    def goes_on(self, *changes: str) -> None:
        reached = self.saved()
        target = f"total_steps={(reached + 1) * STEPS_PER_UPDATE * self.workers}"
        done = subprocess.run(self.words("--resume", str(self.out), *changes, target), capture_output=True, text=True, check=False,
                              timeout=DEADLINE_S)
        expect(done.returncode == 0, f"does not go on from update {reached}: code {done.returncode}, {done.stderr}")
        expect(self.saved() == reached + 1, f"went on from update {reached} to {self.saved()}")

    def as_a_user(self) -> list[str]:
        """What starts a command as someone whom a folder's mode can keep out."""
        if os.geteuid() != 0:
            return []
        for path in [self.folder, *self.folder.iterdir()]:
            os.chown(path, NOBODY, NOBODY)
        return ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]

    def remove(self) -> None:
        if self.process and self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)


def interrupted(run: Run) -> str:
    number, code = run.draw.choice([(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 143), (signal.SIGUSR1, 143)])
    run.start(run.words(ENDLESS))
    run.wait_for_updates(run.draw.randint(1, 12))
    told = run.logged()
    if run.draw.random() < 0.5:
        run.started().send_signal(number)
    else:  # as a terminal or a launcher does it
        os.killpg(run.started().pid, number)
    ended = run.end()
    expect(ended == code, f"{number.name} gave code {ended}: {run.text()}")
    expect(run.saved() >= told, f"update {told} was told, {run.saved()} is saved")
    run.goes_on()
    return f"{code}"


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def lost_worker(run: Run) -> str:
    run.start(run.words(ENDLESS))
    run.wait_for_updates(run.draw.randint(1, 12))
    told = run.logged()
    os.kill(run.draw.choice(children(run.started().pid)), signal.SIGKILL)
    code = run.end()
    expect(code == 3, f"a lost worker gave code {code}: {run.text()}")
    # Rank 0 may have told of an update that the others had not summed up.
    expect(run.saved() >= told - 1, f"update {told} was told, {run.saved()} is saved")
    run.goes_on()
    return "3"


def all_killed(run: Run) -> str:
    """With a checkpoint after each update, as nothing can be written after SIGKILL."""
    run.start(run.words(ENDLESS))
    run.wait_for_updates(run.draw.randint(2, 12))
    told = run.logged()
    os.killpg(run.started().pid, signal.SIGKILL)
    code = run.end()
    expect(code == 137, f"SIGKILL gave code {code}")
    expect(run.saved() >= told - 1, f"update {told} was told, {run.saved()} is saved")
    run.goes_on()
    return "137"


def full_disk(run: Run) -> str:
    """A file system that fills up at a random moment; space comes back once the run says that it waits."""
    large = "policy.hidden_size=256"
    disk = run.folder / "disk"
    disk.mkdir()
    updates = run.draw.randint(4, 10)
    steps = f"total_steps={updates * STEPS_PER_UPDATE * run.workers}"
    megabytes = run.draw.uniform(6.0, 16.0)
    filler = run.draw.uniform(0.2, 0.9) * megabytes
    train = " ".join(run.words(large, steps, f"out={disk}/run"))
    script = f"""mount -t tmpfs -o size={int(megabytes * 1e6)} tmpfs {disk} || exit 77
( until [ -e {disk}/run/events.jsonl ]; do sleep 0.01; done; sleep {run.draw.uniform(0, 0.5):.2f}
  head -c {int(filler * 1e6)} /dev/zero >{disk}/filler 2>/dev/null
  until grep -q "waits for room" {run.log}; do sleep 0.05; done; rm {disk}/filler ) & filling=$!
{train}; code=$?; kill $filling 2>/dev/null
rm -f {disk}/filler; cp -r {disk}/run {run.out}; exit $code"""
    run.start(["unshare", "-Urm", "sh", "-c", script])
    code = run.end()
    if code != 0:
        # A disk on which not even one checkpoint has room fails at once and leaves nothing half-written.
        expect(code == 1 and "No space left" in run.text(), f"a full disk gave code {code}: {run.text()}")
        expect(run.logged() <= 1, f"update {run.logged()} was lost: {run.text()}")
        return "1 (no first checkpoint)"
    expect(run.saved() == updates, f"{run.saved()} of {updates} updates are saved")
    run.goes_on(large, f"out={run.out}")
    return "0, waited" if "waits for room" in run.text() else "0"


def no_memory(run: Run) -> str:
    size = run.draw.choice(["rollout_steps=100000000", "envs_per_worker=2000000"])
    limit_kb = run.draw.randint(2_000_000, 4_000_000)
    run.start(["sh", "-c", f"ulimit -c 0; ulimit -v {limit_kb}; exec " + " ".join(run.words("--force", size))])
    code = run.end()
    expect(code == 1, f"no memory gave code {code}: {run.text()}")
    expect("out of memory" in run.text(), f"no line on memory: {run.text()}")
    # No update was made: the same folder takes a run.
    done = subprocess.run(run.words("--overwrite"), capture_output=True, text=True, check=False, timeout=DEADLINE_S)
    expect(done.returncode == 0, f"the folder takes no run after it: {done.stderr}")
    run.goes_on()
    return "1"


def unwritable(run: Run) -> str:
    """Before the start (exit 2), or a folder that is closed while the run goes on and is opened once the run says that it waits."""
    if run.draw.random() < 0.5:
        (run.folder / "file").write_text("")
        place = run.draw.choice([f"{run.folder}/file/run", "/proc/run", "/sys/run"])
        run.start(run.words(f"out={place}"))
        code = run.end()
        expect(code == 2 and place.rsplit("/", 1)[0] in run.text(), f"{place} gave code {code}: {run.text()}")
        return "2"
    user = run.as_a_user()
    run.start([*user, *run.words(ENDLESS, "checkpoint_every=1")])
    run.wait_for_updates(run.draw.randint(2, 8))
    folder = run.out / "checkpoints"
    folder.chmod(0o500)
    time.sleep(run.draw.uniform(0, 1))
    told = run.logged()
    run.started().send_signal(signal.SIGTERM)
    end = time.monotonic() + DEADLINE_S
    while "waits for room" not in run.text():
        expect(run.started().poll() is None, f"ended without its last checkpoint: {run.text()}")
        expect(time.monotonic() < end, f"does not say that it waits: {run.text()}")
        time.sleep(0.01)
    folder.chmod(0o700)
    code = run.end()
    expect(code == 143, f"an unwritable folder gave code {code}: {run.text()}")
    expect(run.saved() >= told, f"update {told} was told, {run.saved()} is saved")
    run.goes_on()
    return f"{code}, waited"


def bad_weights(run: Run) -> str:
    rate = run.draw.choice(["1e7", "1e8", "1e9", "1e12"])
    back = run.draw.randint(0, 2)
    run.start(run.words(ENDLESS, f"ppo.learning_rate={rate}", f"ppo.roll_backs={back}"))
    code = run.end()
    expect(code == 1 and "the weights have gone bad" in run.text(), f"learning_rate {rate} gave code {code}: {run.text()}")
    expect("ppo.learning_rate" in run.text(), f"the key is not named: {run.text()}")
    run.goes_on("--change", "ppo.learning_rate", "ppo.learning_rate=1e-4", "--change", "ppo.roll_backs", "ppo.roll_backs=0")
    return "1"


KINDS: dict[str, tuple[Callable[[Run], str], int]] = {
    "interrupted": (interrupted, 1000),
    "lost worker": (lost_worker, 1000),
    "all killed": (all_killed, 1),
    "full disk": (full_disk, 1),
    "no memory": (no_memory, 1000),
    "unwritable": (unwritable, 1000),
    "bad weights": (bad_weights, 1000),
}


def main() -> int:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored under nohup, and then by every run as well
    if subprocess.run(["unshare", "-Urm", "mount", "-t", "tmpfs", "tmpfs", "/mnt"], capture_output=True, check=False).returncode != 0:
        print("skipped: no file system can be mounted here")
        return 77
    outcomes: dict[tuple[str, int], list[str]] = {}
    broken: list[str] = []
    cells = [(kind, workers) for kind in KINDS for workers in (1, 2, 3, 4) if not (kind == "lost worker" and workers == 1)]
    for number in range(TRIES):
        kind, workers = cells[number % len(cells)]
        act, every = KINDS[kind]
        run = Run(random.Random(f"{SEED} {number}"), workers, every)
        episodes = subprocess.run([PROGRAM, "dataset", "episodes", "--config", str(run.config)], capture_output=True, check=False)
        assert episodes.returncode == 0, episodes.stderr
        try:
            outcomes.setdefault((kind, workers), []).append(act(run))
        except Broken as error:
            outcomes.setdefault((kind, workers), []).append("BROKEN")
            broken.append(f"try {number}, {kind}, {workers} workers: {error}")
            print(broken[-1], file=sys.stderr, flush=True)
        finally:
            run.remove()
    print(f"{'fault':<14}{'workers':<9}{'tries':<7}{'as documented':<15}exit codes")
    for (kind, workers), seen in sorted(outcomes.items()):
        codes = {code: seen.count(code) for code in sorted(set(seen))}
        print(f"{kind:<14}{workers:<9}{len(seen):<7}{len(seen) - seen.count('BROKEN'):<15}" + json.dumps(codes).strip("{}").replace('"', ""))
    print(f"{TRIES} runs, {TRIES - len(broken)} as documented")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
