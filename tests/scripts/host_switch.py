# SPDX-License-Identifier: Apache-2.0
"""Hosts as network namespaces, whose Ethernet frames this process hands from one to another.  It cuts, delays and loses them as pulled cables and
`tc netem` do, also on kernels without netem.  Needs root, /dev/net/tun and iproute2; nothing of this machine's own network is touched."""
import ctypes
import fcntl
import heapq
import os
import random
import re
import select
import shutil
import struct
import subprocess
import threading
import time

CLONE_NEWNET, TUNSETIFF, IFF_TAP_NO_PI = 0x40000000, 0x400454CA, 0x1002
MTU, FRAME_BYTES, QUEUED_FRAMES = 9000, 9100, 5000
LOOK_S = 0.05
LIBC = ctypes.CDLL(None, use_errno=True)


def missing() -> str:
    """Why there can be no hosts here; empty if there can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if shutil.which("ip") is None:
        return "ip (iproute2) is not installed"
    name = f"earshot{os.getpid()}-probe"
    if subprocess.run(["ip", "netns", "add", name], capture_output=True, check=False).returncode != 0:
        return "this machine gives no network namespaces"
    try:
        entered = subprocess.run(["ip", "netns", "exec", name, "true"], capture_output=True, text=True, check=False)
        if entered.returncode != 0:
            return f"this machine lets no program into a network namespace: {entered.stderr.strip()}"
        os.close(open_tap(name))
    except OSError as error:
        return f"this machine gives no tap devices: {error}"
    finally:
        subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)
    return ""


def delete_hosts_of_the_dead(prefix: str) -> None:
    """Namespaces PREFIX<pid>-... of processes that have gone without close()."""
    listed = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=False).stdout
    for line in listed.splitlines():
        name = line.split()[0] if line.strip() else ""
        found = re.match(re.escape(prefix) + r"(\d+)-", name)
        if found and not os.path.exists(f"/proc/{found[1]}"):
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)


def open_tap(namespace: str) -> int:
    """Descriptor of a tap device, eth0 of the namespace.  A thread enters it, and this process stays outside."""
    result: list[int | OSError] = []

    def enter_and_open() -> None:
        try:
            inside = os.open(f"/run/netns/{namespace}", os.O_RDONLY)
            if LIBC.setns(inside, CLONE_NEWNET) != 0:
                raise OSError(ctypes.get_errno(), "setns")
            os.close(inside)
            tap = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
            fcntl.ioctl(tap, TUNSETIFF, struct.pack("16sH22x", b"eth0", IFF_TAP_NO_PI))
            result.append(tap)
        except OSError as error:
            result.append(error)

    thread = threading.Thread(target=enter_and_open)
    thread.start()
    thread.join()
    if isinstance(result[0], OSError):
        raise result[0]
    return result[0]


class HostSwitch:
    """`count` hosts, host i with the address 10.77.0.(i + 1), and a thread that hands their frames on.  If it dies, `failure` says why.
    Faults may come from any thread.  Raises OSError or SubprocessError where a host cannot be made, and leaves none behind."""

    def __init__(self, count: int, name: str, seed: int = 0) -> None:
        self.names = [f"{name}-{host}" for host in range(count)]
        self.cuts: list[set[tuple[int, int]]] = []  # of ways (from, to)
        self.blocked: set[tuple[int, int]] = set()  # in any of them
        self.cuts_lock = threading.Lock()
        self.delays: dict[int, tuple[float, float]] = {}  # by host, both ways: least and most, in s
        self.losses: dict[int, float] = {}  # by host, both ways: fraction of frames
        self.draw = random.Random(seed)
        self.taps: list[int] = []
        self.is_over = False
        self.failure = ""
        self.thread = threading.Thread(target=self.run, daemon=True)
        try:
            for host in range(count):
                self.make_host(host)
            self.thread.start()
        except BaseException:
            self.close()
            raise

    @staticmethod
    def address(host: int) -> str:
        return f"10.77.0.{host + 1}"

    @staticmethod
    def hardware(host: int) -> str:
        return f"02:00:00:00:00:{host + 1:02x}"

    def make_host(self, host: int) -> None:
        name = self.names[host]
        subprocess.run(["ip", "netns", "add", name], check=True)
        self.taps.append(open_tap(name))
        lines = [f"link set eth0 address {self.hardware(host)} mtu {MTU} txqueuelen {QUEUED_FRAMES}", f"address add {self.address(host)}/24 dev eth0",
                 "link set lo up", "link set eth0 up"]
        lines += [f"neighbour replace {self.address(other)} lladdr {self.hardware(other)} dev eth0 nud permanent"
                  for other in range(len(self.names)) if other != host]
        subprocess.run(["ip", "-n", name, "-batch", "-"], input="\n".join(lines), text=True, check=True)

    def on(self, host: int, command: list[str]) -> list[str]:
        return ["ip", "netns", "exec", self.names[host], *command]

    def cut(self, group: set[int]) -> set[tuple[int, int]]:
        """Blocks all ways between the group and the others.  Returns what to give to heal()."""
        ways = {(a, b) for a in range(len(self.names)) for b in range(len(self.names)) if (a in group) != (b in group)}
        return self.block(ways)

    def cut_way(self, source: int, target: int) -> set[tuple[int, int]]:
        return self.block({(source, target)})

    def block(self, ways: set[tuple[int, int]]) -> set[tuple[int, int]]:
        with self.cuts_lock:
            self.cuts.append(ways)
            self.blocked = set().union(*self.cuts)
        return ways

    def heal(self, ways: set[tuple[int, int]]) -> None:
        """Ends this cut.  Ways that another cut blocks too stay blocked."""
        with self.cuts_lock:
            self.cuts = [cut for cut in self.cuts if cut is not ways]
            self.blocked = set().union(*self.cuts)

    def run(self) -> None:
        try:
            self.hand_on()
        except Exception as error:  # whatever it is, no frame arrives any more
            self.failure = f"the switch between the hosts ended: {error!r}"

    def hand_on(self) -> None:
        """Frames of one delay keep their order; those of a delay with a range need not."""
        poll = select.poll()
        source_of = {tap: host for host, tap in enumerate(self.taps)}
        for tap in self.taps:
            poll.register(tap, select.POLLIN)
        waiting: list[tuple[float, int, int, bytes]] = []
        number = 0
        while not self.is_over:
            wait_s = min(LOOK_S, max(0.0, waiting[0][0] - time.monotonic())) if waiting else LOOK_S
            for tap, _ in poll.poll(1000 * wait_s):
                try:
                    frame = os.read(tap, FRAME_BYTES)
                except OSError:
                    continue
                target, source = frame[5] - 1, source_of[tap]
                if frame[0] != 2 or not 0 <= target < len(self.taps) or not self.passes(source, target):
                    continue
                ranges = [self.delays.get(host) for host in (source, target)]
                delay_s = sum(self.draw.uniform(*range_s) for range_s in ranges if range_s is not None)
                number += 1
                heapq.heappush(waiting, (time.monotonic() + delay_s, number, target, frame))
            while waiting and waiting[0][0] <= time.monotonic():
                _, _, target, frame = heapq.heappop(waiting)
                try:
                    os.write(self.taps[target], frame)
                except OSError:
                    pass  # a host that is down, or whose queue is full

    def passes(self, source: int, target: int) -> bool:
        if (source, target) in self.blocked:
            return False
        return all(self.draw.random() >= self.losses.get(host, 0.0) for host in (source, target))

    def close(self) -> None:
        self.is_over = True
        if self.thread.ident is not None:
            self.thread.join()
        for tap in self.taps:
            os.close(tap)
        for name in self.names:
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)
