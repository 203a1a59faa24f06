# SPDX-License-Identifier: Apache-2.0
"""Parts of corpora that earshot.ray and earshot.dask make, joined to the bytes of one process; without Ray and Dask."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from corpora import PROGRAM, needs_program, small_config

import earshot
from earshot import _corpus_parts
from earshot._program import find_program, run_program
from earshot._progress import Progress
from earshot._wav import samples_of, wav

CONFIG = small_config(shoeboxes=5, rooms_per_folder=2)


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def make(command: str, arguments: list[str], out: Path, rng: np.random.Generator) -> None:
    """As the parts are made on nodes, in a drawn order; half of them before an interruption."""
    work = _corpus_parts.plan(command, arguments, out, PROGRAM)
    order = [int(folder) for folder in rng.permutation(work.missing)]
    for folder in order[: len(order) // 2]:
        _corpus_parts.keep_part(work.out, folder, _corpus_parts.make_part(work, folder, 1, str(out.parent)))
    again = _corpus_parts.plan(command, arguments, out, PROGRAM)
    assert sorted(again.missing) == sorted(order[len(order) // 2 :])
    for folder in again.missing:
        _corpus_parts.keep_part(again.out, folder, _corpus_parts.make_part(again, folder, 2, str(out.parent)))
    _corpus_parts.join(again)
    assert _corpus_parts.plan(command, arguments, out, PROGRAM).missing == ()


@needs_program
def test_parts_in_any_order_give_the_bytes_of_one_process(tmp_path: Path) -> None:
    """Ten corpora with drawn settings.  Equal bytes: any mistake in a part, its order or its place fails."""
    rng = np.random.default_rng(39)
    (tmp_path / "rir.yaml").write_text(CONFIG)
    for number in range(10):
        drawn = {
            "seed": rng.integers(1000),
            "shoeboxes.count": rng.integers(1, 6),
            "rooms_per_folder": rng.integers(1, 4),
            "sources_per_room": rng.integers(1, 3),
            "channels": rng.choice(["mono", "binaural", "ambisonic:1"]),
            "format": rng.choice(["wav", "flac"]),
            "split_ms": rng.choice([0, 20]),
        }
        arguments = [str(tmp_path / "rir.yaml"), *(text for key, value in drawn.items() for text in ("--set", f"{key}={value}"))]
        one, parts = tmp_path / f"one{number}", tmp_path / f"parts{number}"
        run_program([PROGRAM, "dataset", "rir", *arguments, "--out", str(one), "--threads", "1"], cwd=str(tmp_path))
        make("rir", arguments, parts, rng)
        assert bytes_of(parts) == bytes_of(one), drawn


@needs_program
def test_speech_scenes_and_panoramas_are_made_in_parts_too(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    (tmp_path / "rir.yaml").write_text(CONFIG)
    responses = tmp_path / "rir"
    run_program([PROGRAM, "dataset", "rir", str(tmp_path / "rir.yaml"), "--out", str(responses)], cwd=str(tmp_path))
    speech = tmp_path / "speech"
    speech.mkdir()
    for number in range(3):
        (speech / f"{number}.wav").write_bytes(wav(rng.uniform(-0.5, 0.5, (1, 4000)).astype(np.float32), 16000))
    scenes = CONFIG.replace(
        "sources_per_room: 1\nlisteners_per_source: 2", "recordings_per_room: 1\nduration_s: 1\nevents: [1, 1]\nevent_s: [0.5, 0.5]"
    )
    (tmp_path / "scenes.yaml").write_text(scenes + "classes: {click: synth:click}\n")
    corpora: list[tuple[str, list[str]]] = [
        ("convolve", [str(responses), "--speech", str(speech), "--noise", "synth", "--count", "13", "--signals-per-folder", "5"]),
        ("scenes", [str(tmp_path / "scenes.yaml")]),
        ("pano", ["shoebox:4x3x4", "--pairs", "3", "--size", "32x12", "--length", "0.1"]),
    ]
    for command, arguments in corpora:
        one, parts = tmp_path / f"{command}_one", tmp_path / f"{command}_parts"
        run_program([PROGRAM, "dataset", command, *arguments, "--out", str(one)], cwd=str(tmp_path))
        make(command, arguments, parts, rng)
        assert bytes_of(parts) == bytes_of(one), command
        assert len(bytes_of(parts)) > 3


@needs_program
def test_wrong_use_is_refused_with_one_line(tmp_path: Path) -> None:
    config = tmp_path / "rir.yaml"
    config.write_text(CONFIG)

    def refused(match: str, command: str, arguments: Any, out: Path = tmp_path / "out", program: str = PROGRAM) -> None:
        with pytest.raises((earshot.InputError, TypeError), match=match) as error:
            _corpus_parts.plan(command, arguments, out, program)
        assert "\n" not in str(error.value)

    refused("'grid' is none that is made in parts; use one of rir", "grid", ["house:7"])
    refused("--out is the argument out", "rir", [str(config), "--out", "other"])
    refused("--shard is set for each part", "rir", [str(config), "--shard=1/2"])
    refused("--threads is the argument cpus_per_part", "rir", [str(config), "--threads", "2"])
    refused("must be a list of texts", "rir", str(config))
    refused("must be a list of texts", "rir", [str(config), 3])
    refused("no.yaml", "rir", [str(tmp_path / "no.yaml")])
    refused("shoebox", "rir", [str(config), "--set", "shoebox=1"])
    refused("is not found or cannot be executed; set EARSHOT_PROGRAM", "rir", [str(config)], program=str(config))
    assert not (tmp_path / "out").exists()
    _corpus_parts.plan("rir", [str(config)], tmp_path / "out", PROGRAM)
    refused("was started with other settings: 'seed: 1' there, 'seed: 2' here", "rir", [str(config), "--set", "seed=2"])


def test_the_program_is_named_by_argument_variable_or_path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "earshot"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setenv("EARSHOT_PROGRAM", str(program))
    assert find_program() == str(program)
    monkeypatch.delenv("EARSHOT_PROGRAM")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_program() == str(program)
    monkeypatch.chdir(tmp_path)
    assert find_program("./earshot") == str(program)
    program.unlink()
    with pytest.raises(earshot.InputError, match="program earshot: is not found"):
        find_program()


def test_errors_of_the_program_keep_their_kind() -> None:
    def failing(script: str) -> None:
        run_program(["/bin/sh", "-c", script, "x"], cwd="/")

    with pytest.raises(earshot.InputError, match=r"^a\.yaml: is wrong$"):
        failing("echo progress; echo 'earshot: a.yaml: is wrong' >&2; exit 2")
    with pytest.raises(earshot.RunError, match="failed with code 3: lost its workers"):
        failing("echo 'earshot: lost its workers'; exit 3")
    with pytest.raises(earshot.RunError, match="was ended by signal 9"):
        failing("kill -9 $$")
    with pytest.raises(ZeroDivisionError):  # an error of the poll ends the program
        run_program(["/bin/sleep", "60"], cwd="/", poll=lambda: print(1 // 0), poll_s=0.05)


def test_the_program_ends_with_a_killed_process(tmp_path: Path) -> None:
    mark = tmp_path / "pid"
    code = f"from earshot._program import run_program; run_program(['/bin/sh', '-c', 'echo $$ > {mark}; exec sleep 120'], cwd='/')"
    with subprocess.Popen([sys.executable, "-c", code]) as parent:
        end = time.monotonic() + 60
        while not (mark.exists() and mark.read_text().strip()) and time.monotonic() < end:
            time.sleep(0.05)
        child = int(mark.read_text())
        parent.send_signal(signal.SIGKILL)
    while time.monotonic() < end:
        state = Path(f"/proc/{child}/stat").read_text().split()[2] if Path(f"/proc/{child}/stat").exists() else "gone"
        if state in ("gone", "Z"):
            break
        time.sleep(0.05)
    assert state in ("gone", "Z")


def test_progress_has_the_rate_and_the_time_to_go(capsys: pytest.CaptureFixture[str]) -> None:
    line = Progress("corpus runs/rir", "parts", 40, every_s=0.0)
    assert line.line(10, 20.0, "1000 recordings") == "corpus runs/rir  25 %  10/40 parts  0.5 parts/s  60 s to go  1000 recordings"
    line.update(10)
    line.close()
    assert capsys.readouterr().err.startswith("corpus runs/rir  25 %  10/40 parts")
    Progress("x", "parts", 3, shown=False, every_s=0.0).update(3)
    assert capsys.readouterr().err == ""


def test_sound_files_are_read_back() -> None:
    rng = np.random.default_rng(2)
    for channels in (1, 2, 5):
        floats = rng.uniform(-1, 1, (channels, 37)).astype(np.float32)
        got, rate_hz = samples_of(wav(floats, 44100), "a.wav")
        assert rate_hz == 44100
        assert np.array_equal(got, floats)
        integers = rng.integers(-(2**15), 2**15, (channels, 37)).astype(np.int16)
        assert np.array_equal(samples_of(wav(integers, 8000), "a.wav")[0], integers.astype(np.float32) / 2**15)
    # 24 bits, by hand: 0x400000 is a half of full scale, 0xC00000 minus a half.
    header = wav(np.zeros((1, 1), np.int16), 16000)[:44]
    wide = header[:34] + (24).to_bytes(2, "little") + header[36:40] + (6).to_bytes(4, "little") + bytes([0, 0, 0x40, 0, 0, 0xC0])
    assert samples_of(wide, "a.wav")[0].tolist() == [[0.5, -0.5]]
    with pytest.raises(earshot.InputError, match=r"a.wav: is no WAV file"):
        samples_of(b"fLaC", "a.wav")
    with pytest.raises(earshot.InputError, match=r"a.wav: has no samples"):
        samples_of(header[:36], "a.wav")
