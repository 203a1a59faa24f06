# SPDX-License-Identifier: Apache-2.0
"""One hash for 100 poses and one for 200 steps: those of the C++ test (tests/pinned/promise_test.cpp) and of the command line."""

from __future__ import annotations

import os
import platform
import re
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
import xxhash
from numpy.typing import NDArray

import earshot
from earshot import _engine
from earshot._engine_batch import Batch

PINNED = Path(__file__).parents[2] / "tests" / "pinned"
#: An installed wheel transforms sound by other libraries than the program, whose sound differs by rounding.
INSTALLED = "site-packages" in earshot.__file__
HOUSE = "house:1,rooms=3,area_m2=60"
SOURCE = (2.0, 1.5, 2.0)
POSES, STEPS, ENVS = 100, 200, 3


class BitHash:
    """XXH3 over any number of arrays, each seeded by the hash of those before."""

    def __init__(self) -> None:
        self.value = 0

    def add(self, values: NDArray[np.generic]) -> None:
        self.value = xxhash.xxh3_64_intdigest(np.ascontiguousarray(values).tobytes(), seed=self.value)

    def hex(self) -> str:
        return f"{self.value:016x}"


def key() -> tuple[str, str]:
    """Toolchain and instruction set of a stage with rays and sound, as tests/support/files/pinned_bits.h has them."""
    tracer = "embree" + _engine.ray_tracer_version().rpartition(".")[0]
    loaded = re.search(r"/libavutil\.so\.(\d+)", Path("/proc/self/maps").read_text())
    transforms = f"libavutil{loaded[1]}" if loaded else "permissive"
    return f"{_engine.__compiler__}/{tracer}/{transforms}", "x86-64-v3" if platform.machine() == "x86_64" else "armv8-a"


def pinned_hash(stage: str, toolchain: str, instruction_set: str) -> str | None:
    for row in (PINNED / "bits.csv").read_text().splitlines():
        columns = row.split(",")
        if columns[0] == stage and toolchain in columns[1].split("|") and columns[2] == instruction_set:
            return columns[3]
    return None


def expect_pinned(stage: str, bits: BitHash) -> None:
    """Fails without a row where CI is set, unless EARSHOT_ALLOW_MISSING_PINS=1: the rule of tests/support/files/pinned_rows.h."""
    if INSTALLED:
        pytest.skip("pinned bits are of the release build, not of the libraries of a wheel")
    toolchain, instruction_set = key()
    pinned = pinned_hash(stage, toolchain, instruction_set)
    if pinned is None:
        missing = f"no pinned bits; the row to add to {PINNED / 'bits.csv'} is\n{stage},{toolchain},{instruction_set},{bits.hex()}"
        if os.environ.get("CI") and os.environ.get("EARSHOT_ALLOW_MISSING_PINS") != "1":
            pytest.fail(missing)
        pytest.skip(missing)
    assert bits.hex() == pinned


def poses() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places [100, 3] and headings in degrees, as tests/pinned/promise_test.cpp has them."""
    number = np.arange(POSES)
    places: NDArray[np.float64] = np.stack([1.013 + 0.2471 * (number % 10), np.full(POSES, 1.5), 1.029 + 0.2437 * (number // 10)], axis=1)
    headings = (36 * (number % 10)).astype(np.float64)
    return places, headings


def render(threads: int) -> NDArray[np.float32]:
    scene = earshot.Scene(HOUSE, preset="fast", settings={"rir_length_s": 0.3})
    places, headings = poses()
    return scene.source(SOURCE).render(places, headings, channels="binaural", threads=threads)


def hash_of(rirs: NDArray[np.float32]) -> BitHash:
    bits = BitHash()
    for rir in rirs:
        bits.add(rir)
    return bits


def test_a_hundred_poses_have_the_pinned_bits_on_any_number_of_threads() -> None:
    first = hash_of(render(1))
    for threads in (2, 4, 8):
        assert hash_of(render(threads)).hex() == first.hex(), threads
    expect_pinned("rirs_100_poses", first)


def samples_of(path: Path) -> NDArray[np.float32]:
    """[channels, samples] of a WAV file of 32-bit floats."""
    data = path.read_bytes()
    assert data[:4] == b"RIFF"
    channels, at = 0, 12
    while True:
        name, size = data[at : at + 4], struct.unpack_from("<I", data, at + 4)[0]
        if name == b"fmt ":
            channels = struct.unpack_from("<H", data, at + 10)[0]
            assert struct.unpack_from("<H", data, at + 22)[0] == 32
        if name == b"data":
            return np.frombuffer(data, np.float32, size // 4, at + 8).reshape(-1, channels).T
        at += 8 + size + size % 2


def test_the_command_line_writes_the_same_bits(tmp_path: Path) -> None:
    program = os.environ.get("EARSHOT_PROGRAM")
    if not program or INSTALLED:
        pytest.skip("EARSHOT_PROGRAM names no program that was built with the libraries of the package")
    places, headings = poses()
    rirs = render(2)
    for threads in (1, 2, 4, 8):
        out = tmp_path / f"threads{threads}"
        out.mkdir()
        settings = ["--preset", "fast", "--set", "rir_length_s=0.3", f"threads={threads}"]
        command = [program, "rir", HOUSE, *settings, "--out", str(out / "rir.wav"), "--source", ",".join(map(str, SOURCE))]
        command += ["--heading", ",".join(map(str, headings))]
        for place in places:
            command += ["--listener", ",".join(map(str, place))]
        subprocess.run(command, check=True, capture_output=True)
        written = np.stack([samples_of(out / f"rir.s0.l{pose}.wav") for pose in range(POSES)])
        assert np.array_equal(written.view(np.uint32), rirs.view(np.uint32)), threads


def open_batch(threads: int) -> Batch:
    episodes = f"episodes.file={PINNED / 'episodes.json'}"
    return earshot.make_vec(PINNED / "batch.yaml", num_envs=ENVS, overrides=[episodes], threads=threads).batch


def hash_of_steps(threads: int, *, restored: bool) -> BitHash:
    """Of every sensor, reward and flag; restored: half way the state goes on in another batch, with another number of threads."""
    batch = open_batch(threads)
    batch.reset()
    bits = BitHash()
    for step in range(STEPS):
        if restored and step == STEPS // 2:
            state = batch.save_state()
            batch = open_batch(9 - threads)
            batch.restore_state(state)
        batch.step(np.array([1 + (step * 3 + env * 5) % 7 % 3 for env in range(ENVS)], dtype=np.int32))
        for name, *_ in batch.sensors():
            bits.add(batch.rows(name))
        for values in (batch.rewards(), batch.terminated(), batch.truncated()):
            bits.add(values)
    return bits


def test_the_command_line_steps_to_the_same_bits() -> None:
    program = os.environ.get("EARSHOT_PROGRAM")
    if not program or INSTALLED:
        pytest.skip("EARSHOT_PROGRAM names no program that was built with the libraries of the package")
    expected = hash_of_steps(1, restored=False).hex()
    command = [program, "bench", "bits", "--env", str(PINNED / "batch.yaml"), "--episodes", str(PINNED / "episodes.json")]
    for threads in (1, 2, 4, 8):
        for restored in ([], ["--restored", str(9 - threads)]):
            call = [*command, "--threads", str(threads), *restored]
            assert subprocess.run(call, check=True, capture_output=True, text=True).stdout.split()[0] == expected, call


def test_two_hundred_steps_have_the_pinned_bits_fresh_and_restored_on_any_number_of_threads() -> None:
    first = hash_of_steps(1, restored=False)
    for threads in (1, 2, 4, 8):
        for restored in (False, True):
            assert hash_of_steps(threads, restored=restored).hex() == first.hex(), (threads, restored)
    expect_pinned("batch_200_steps", first)
