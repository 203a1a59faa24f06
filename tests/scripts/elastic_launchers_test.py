# SPDX-License-Identifier: Apache-2.0
"""The start scripts of configs/launch with the launchers that are installed here: 2 workers, of which one is killed; then 4 workers, of which one is
killed; then 3, to the end.  After each loss the run goes on from its last whole update.  Ends with 77 (skipped) where a launcher is missing.

  elastic_launchers_test.py EARSHOT [torchrun] [mpirun] [slurm] [--steps A,B,C]

--steps: numbers of workers change from A and from B steps on, and the run ends at C steps.  Prints the curve, and those of runs of 2, 3 and 4 workers
that nothing disturbs, for docs/evidence/workers.md.
"""
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

from elastic_runs import Run, free_port

LAUNCH = pathlib.Path(__file__).resolve().parents[2] / "configs" / "launch"


class Missing(Exception):
    pass


class Phases:
    """When the numbers of workers change: after a few updates each, or at given steps."""

    def __init__(self, run, steps):
        self.run, self.steps = run, steps

    def reach(self, workers, phase, look=lambda: None):
        """Until the run has `workers` workers and is as far as this phase goes."""
        self.run.wait_for(workers, look=look)
        if self.steps:
            self.run.wait(lambda: self.run.newest()["env_steps"] >= self.steps[phase], f"{self.steps[phase]} steps", look)

    def end_soon(self, workers):
        if not self.steps:
            self.run.end_soon(workers)


def start(run, command, **variables):
    log = open(run.log, "a")
    environment = {**os.environ, "EARSHOT": run.earshot, **variables}
    return subprocess.Popen([str(part) for part in command], env=environment, stdout=log, stderr=log, stdin=subprocess.DEVNULL, start_new_session=True)


def need(*programs):
    for program in programs:
        if shutil.which(program) is None:
            raise Missing(f"{program} is not installed")


def end_group(process):
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGTERM)
        try:
            process.wait(timeout=40)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def by_mpirun(run, phases):
    need("mpirun")
    number = run.folder / "workers"
    number.write_text("2\n")
    process = start(run, [LAUNCH / "mpirun.sh", number, run.config], EARSHOT_MPIRUN="--oversubscribe", OMPI_ALLOW_RUN_AS_ROOT="1",
                    OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")
    try:
        phases.reach(2, 0)
        number.write_text("4\n")
        run.kill_worker()
        phases.reach(4, 1)
        number.write_text("3\n")
        phases.end_soon(3)
        run.kill_worker()
        run.wait(lambda: process.poll() is not None, "the end")
        assert process.returncode == 0, run.said()
    finally:
        end_group(process)


def by_torchrun(run, phases):
    """Three agents on this machine, as of three hosts: the first has two workers, the others one each, and the last is killed with its worker."""
    need("torchrun")
    address = socket.getaddrinfo(socket.getfqdn(), None, type=socket.SOCK_STREAM)[0][4][0]
    port = free_port()
    agents = []

    def start_agent(node, workers):
        agents.append(start(run, [LAUNCH / "torchrun.sh", workers, run.config], EARSHOT_NODES="1:3", EARSHOT_NODE=str(node), MASTER_ADDR="127.0.0.1",
                            MASTER_PORT=str(port), EARSHOT_RUN_ID="elastic", EARSHOT_KEYS=str(run.keys), EARSHOT_TORCHRUN="--monitor_interval 1",
                            **loopback))

    # Agents name the host of rank 0 as its own host calls itself; an address of the loopback interface leads no other host there.
    loopback = {"EARSHOT_RENDEZVOUS": f"tcp://127.0.0.1:{free_port()}"} if address.startswith("127.") or address == "::1" else {}
    try:
        start_agent(0, 2)
        phases.reach(2, 0)
        before = run.newest()["update"]
        run.kill_worker()
        run.wait(lambda: run.newest()["update"] > before + 3, "updates after a killed worker")
        start_agent(1, 1)
        start_agent(2, 1)
        phases.reach(4, 1)
        phases.end_soon(3)
        os.killpg(agents[2].pid, signal.SIGKILL)  # its worker dies with it, as with a lost host
        run.wait(lambda: agents[0].poll() is not None and agents[1].poll() is not None, "the end")
        assert agents[0].returncode == 0, run.said()
    finally:
        for agent in agents:
            end_group(agent)


class Slurm:
    """The daemons of Slurm for nodes n1, n2, ... of one CPU each on this machine, from a folder, without munge, systemd or cgroups."""

    def __init__(self, folder, num_nodes):
        need("slurmctld", "slurmd", "sbatch", "scontrol", "squeue")
        if os.geteuid() != 0:
            raise Missing("the daemons of Slurm need root")
        self.folder = pathlib.Path(folder)
        (self.folder / "state").mkdir(parents=True)
        host = socket.gethostname().split(".")[0]
        self.names = [f"n{i}" for i in range(1, num_nodes + 1)]
        settings = {
            "ClusterName": "test", "SlurmctldHost": f"{host}(127.0.0.1)", "SlurmctldPort": free_port(), "SlurmUser": "root", "SlurmdUser": "root",
            "AuthType": "auth/none", "CredType": "cred/none", "ProctrackType": "proctrack/linuxproc", "TaskPlugin": "task/none",
            "SelectType": "select/cons_tres", "SelectTypeParameters": "CR_Core", "ReturnToService": 2, "MpiDefault": "none",
            "SwitchType": "switch/none", "SchedulerParameters": "sched_min_interval=0", "SlurmdParameters": "config_overrides",
            "StateSaveLocation": self.folder / "state", "SlurmdSpoolDir": self.folder / "spool.%n", "SlurmctldPidFile": self.folder / "slurmctld.pid",
            "SlurmdPidFile": self.folder / "slurmd.%n.pid", "SlurmctldLogFile": self.folder / "slurmctld.log",
            "SlurmdLogFile": self.folder / "slurmd.%n.log"}
        lines = [f"{key}={value}" for key, value in settings.items()]
        lines += [f"NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={free_port()} CPUs=1 State=UNKNOWN" for name in self.names]
        lines.append(f"PartitionName=all Nodes={','.join(self.names)} Default=YES State=UP")
        (self.folder / "slurm.conf").write_text("\n".join(lines) + "\n")
        # Slurm 24 looks for control groups even where no plugin uses them; 22 does not know the word for none.
        version = subprocess.run(["slurmd", "-V"], capture_output=True, text=True).stdout.split()[1]
        if int(version.split(".")[0]) >= 24:
            (self.folder / "cgroup.conf").write_text("CgroupPlugin=disabled\n")
        os.environ["SLURM_CONF"] = str(self.folder / "slurm.conf")
        log = open(self.folder / "daemons.log", "w")
        self.daemons = [subprocess.Popen(command, stdout=log, stderr=log, stdin=subprocess.DEVNULL, start_new_session=True)
                        for command in (["slurmctld", "-D"], *(["slurmd", "-D", "-N", name] for name in self.names))]
        for _ in range(600):
            if self.ask("sinfo", "-h", "-N", "-o", "%t").split().count("idle") == num_nodes:
                return
            time.sleep(0.1)
        self.end()
        raise Missing("the daemons of Slurm did not come up within 60 s")

    def ask(self, *command):
        return subprocess.run(command, capture_output=True, text=True).stdout

    def end(self):
        self.ask("scancel", "--full", "--signal=KILL", "--user=root")
        self.ask("scontrol", "shutdown")
        for daemon in self.daemons:
            try:
                daemon.wait(timeout=10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()
        del os.environ["SLURM_CONF"]


def by_slurm(run, phases):
    """A job of 1 to 4 nodes: each time it is queued again it takes those that are free."""
    slurm = Slurm(run.folder / "slurm", 4)
    try:
        set_state = lambda names, state: slurm.ask("scontrol", "update", f"nodename={names}", f"state={state}", "reason=test")
        set_state("n3,n4", "drain")
        environment = {**os.environ, "EARSHOT": run.earshot, "EARSHOT_OUT": str(run.out), "EARSHOT_KEYS": str(run.keys),
                       "EARSHOT_WORKERS_PER_NODE": "1", "EARSHOT_RENDEZVOUS": f"tcp://127.0.0.1:{free_port()}"}  # names of the nodes are no hosts
        done = subprocess.run(["sbatch", "--parsable", "--nodes=1-4", "-o", str(run.log), str(LAUNCH / "slurm.sbatch"),
                               str(run.config)], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        job = done.stdout.strip()

        def look():
            if "PENDING" in slurm.ask("squeue", "-h", "-t", "all", "-j", job, "-o", "%T"):
                slurm.ask("scontrol", "update", f"jobid={job}", "StartTime=now")  # Slurm lets a queued job wait for two minutes

        phases.reach(2, 0, look)
        set_state("n3,n4", "resume")
        run.kill_worker()
        phases.reach(4, 1, look)
        set_state("n4", "drain")
        phases.end_soon(3)
        run.kill_worker()
        run.wait(lambda: "COMPLETED" in slurm.ask("squeue", "-h", "-t", "all", "-j", job, "-o", "%T"), "the end", look)
    finally:
        slurm.end()


def curve_text(points):
    """Reward per episode at six places of the run, the number of workers at each, and the mean over the last fifth."""
    last = points[-1]["env_steps"]
    cells = []
    for place in range(1, 7):
        point = next(point for point in points if point["env_steps"] >= last * place / 6)
        cells.append(f"{point['values']['episodes/reward']:.2f} ({point['workers']})")
    tail = [point["values"]["episodes/success"] for point in points if point["env_steps"] > 0.8 * last]
    return " | ".join(cells) + f" | {sum(tail) / len(tail):.3f}"


def main(earshot, names, steps):
    launchers = {"torchrun": by_torchrun, "mpirun": by_mpirun, "slurm": by_slurm}
    missing = []
    for name in names or launchers:
        began = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            run = Run(folder, earshot, steps[2]) if steps else Run(folder, earshot)
            try:
                launchers[name](run, Phases(run, steps))
            except Missing as reason:
                missing.append(f"{name}: {reason}")
                continue
            points = run.check_curve([2, 4, 3])
            numbers = [point["workers"] for point in points]
            print(f"{name}: {', '.join(f'{numbers.count(n)} updates of {n} workers' for n in (2, 4, 3))} in {time.monotonic() - began:.0f} s", flush=True)
            if steps:
                print(f"| {name} | {curve_text(points)} |", flush=True)
    for workers in (2, 3, 4) if steps else ():
        with tempfile.TemporaryDirectory() as folder:
            run = Run(folder, earshot, steps[2])
            process = start(run, [earshot, "train", run.config, "--workers", workers])
            run.wait(lambda: process.poll() is not None, "the end")
            print(f"| {workers} workers, undisturbed | {curve_text(run.points())} |", flush=True)
    if missing:
        print("skipped: " + "; ".join(missing))
        return 77
    return 0


if __name__ == "__main__":
    arguments = sys.argv[2:]
    at = [int(step) for step in arguments[arguments.index("--steps") + 1].split(",")] if "--steps" in arguments else None
    sys.exit(main(os.path.abspath(sys.argv[1]), [name for name in arguments if name in ("torchrun", "mpirun", "slurm")], at))
