# SPDX-License-Identifier: Apache-2.0
"""The curve of a run reaches each tracker once, with its values, while it is written and after."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import math
import os
import random
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import pytest

import earshot
import earshot.config
from earshot.integrations import tracking
from earshot.integrations.runs import Point, follow, is_under_way, points

VALUES = [Point(update, 600 * update, 1.5 * update, {"episodes/success": 0.01 * update, "ppo/loss": 1 / update}) for update in range(1, 41)]


def line_of(point: Point) -> bytes:
    values = {**point.values, "episodes/spl": None}
    return json.dumps({"update": point.update, "env_steps": point.env_steps, "wall_s": point.wall_s, "values": values}).encode() + b"\n"


def lock(folder: Path) -> BinaryIO:
    """As earshot train holds it; released by close()."""
    file = open(folder / "run.lock", "w+b")  # noqa: SIM115  # the caller closes it
    fcntl.fcntl(file, fcntl.F_OFD_SETLK, struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0))
    return file


def write(folder: Path, pieces: list[bytes]) -> None:
    held = lock(folder)
    for piece in pieces:
        with open(folder / "events.jsonl", "ab") as file:
            file.write(piece)
        time.sleep(0.01)
    (folder / "run.lock").unlink()
    held.close()


def test_points_of_a_finished_run(tmp_path: Path) -> None:
    (tmp_path / "events.jsonl").write_bytes(b"".join(map(line_of, VALUES)) + b'{"update": 41')  # torn
    assert points(tmp_path) == VALUES
    assert list(follow(tmp_path)) == VALUES


@pytest.mark.parametrize("seed", range(3))
def test_points_of_a_run_under_way(seed: int, tmp_path: Path) -> None:
    """Whatever the pieces in which the file grows."""
    text = b"".join(map(line_of, VALUES))
    cuts = sorted(random.Random(seed).sample(range(1, len(text)), 30))
    pieces = [text[begin:end] for begin, end in zip([0, *cuts], [*cuts, len(text)], strict=True)]
    writer = threading.Thread(target=write, args=(tmp_path, pieces))
    writer.start()
    try:
        assert list(follow(tmp_path, poll_s=0.005, wait_s=30)) == VALUES
    finally:
        writer.join()


def test_a_resumed_run_repeats_nothing(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    held = lock(tmp_path)
    evaluation = Point(7, 4200, 11.0, {"held_out/argmax_success": 0.5})
    path.write_bytes(b"".join(map(line_of, [*VALUES[:7], evaluation, *VALUES[7:10]])))
    found = []
    for point in follow(tmp_path, poll_s=0.005):
        found.append(point)
        if point.update == 10:
            path.write_bytes(b"".join(map(line_of, VALUES[:5])))  # cut at a checkpoint
            time.sleep(0.02)
        if len(found) == 11:
            with open(path, "ab") as file:
                file.writelines(map(line_of, [*VALUES[5:7], evaluation, *VALUES[7:12]]))
            (tmp_path / "run.lock").unlink()
            held.close()
    assert found == [*VALUES[:7], evaluation, *VALUES[7:12]]


@pytest.mark.parametrize("seed", range(6))
def test_a_recovered_run_that_has_grown_past_what_was_read(seed: int, tmp_path: Path) -> None:
    """Its lines have other times, and so other lengths: whatever the line at which the reader was."""
    path, rng = tmp_path / "events.jsonl", random.Random(seed)
    kept = rng.randrange(1, 9)
    held = lock(tmp_path)
    path.write_bytes(b"".join(map(line_of, VALUES[:10])))
    later = [dataclasses.replace(point, wall_s=point.wall_s + rng.choice([0.25, 1000.125])) for point in VALUES[kept:]]
    found = []
    for point in follow(tmp_path, poll_s=0.005):
        found.append(point)
        if len(found) == 10:
            path.write_bytes(b"".join(map(line_of, [*VALUES[:kept], *later])))
            (tmp_path / "run.lock").unlink()
            held.close()
    assert found == [*VALUES[:10], *later[10 - kept :]]
    path.write_bytes(b"".join(map(line_of, VALUES)))
    assert points(tmp_path) == VALUES


def test_another_run_in_the_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "events.jsonl").write_bytes(b"".join(map(line_of, VALUES)))
    held = lock(tmp_path)
    following = follow(tmp_path, poll_s=0.005)
    assert [next(following) for _ in VALUES] == VALUES
    (tmp_path / "events.jsonl").write_bytes(line_of(VALUES[3]))
    with pytest.raises(earshot.RunError, match="another run has taken the folder; follow it anew"):
        next(following)
    held.close()


def test_a_killed_run_is_not_under_way(tmp_path: Path) -> None:
    assert not is_under_way(tmp_path)
    held = lock(tmp_path)
    os.utime(tmp_path / "run.lock", (0, 0))
    assert is_under_way(tmp_path)
    held.close()
    assert not is_under_way(tmp_path)


def test_what_is_no_run_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(earshot.InputError, match=r"has no events.jsonl; name the folder of a training run"):
        points(tmp_path)
    for text in (b"[]\n", b"{}\n", b'{"update": 1, "env_steps": "x", "wall_s": 0, "values": {}}\n', b"\xff\n"):
        (tmp_path / "events.jsonl").write_bytes(line_of(VALUES[0]) + text)
        with pytest.raises(earshot.InputError, match=r"events.jsonl:2: is no point of a curve"):
            points(tmp_path)
    assert tracking.main([str(tmp_path / "none"), "--to", "tensorboard", "--wait-s", "0"]) == 2
    assert not (tmp_path / "none").exists()


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "events.jsonl").write_bytes(b"".join(map(line_of, VALUES)))
    return folder


class RefusedError(Exception):
    """As a tracker raises it."""


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (RefusedError("no permission for rooms\nask its owner\n"), 1, "tensorboard: RefusedError: no permission for rooms"),
        (RefusedError(), 1, "tensorboard: RefusedError: no reason given"),
        (ConnectionRefusedError(111, "Connection refused"), 1, "tensorboard: ConnectionRefusedError: [Errno 111] Connection refused"),
        (PermissionError(13, "Permission denied", "/out"), 2, "/out: Permission denied"),
        (OSError(28, "No space left on device", "/out"), 2, "/out: No space left on device"),
    ],
)
@pytest.mark.parametrize("place", ["_logger", "log", "close"])
def test_errors_of_trackers_and_files_are_one_line(
    place: str, error: Exception, status: int, words: str, run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    if place == "_logger":
        monkeypatch.setattr(tracking, "_logger", fail)
    else:
        monkeypatch.setattr(tracking, "_logger", lambda _: tracking.Logger())
        monkeypatch.setattr(tracking.Logger, "_write", lambda *_: None)
        monkeypatch.setattr(tracking.Logger, place, fail)
    assert tracking.main([str(run), "--to", "tensorboard"]) == status
    assert capsys.readouterr().err == f"tracking: {words}\n"


def test_files_in_place_of_folders_are_one_line(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "file"
    file.write_text("")
    assert tracking.main([str(file), "--to", "tensorboard", "--wait-s", "0"]) == 2
    assert capsys.readouterr().err.startswith(f"tracking: {file}/")
    pytest.importorskip("tensorboard", reason="no tensorboard")
    assert tracking.main([str(run), "--to", "tensorboard", "--out", str(file / "out")]) == 2
    written = capsys.readouterr().err
    assert written.startswith(f"tracking: {file}")
    assert written.count("\n") == 1


def check_history(history: dict[str, list[tuple[int, float]]]) -> None:
    """Of every point: value and step of each metric."""
    for name in ("episodes/success", "ppo/loss"):
        assert [step for step, _ in history[name]] == [point.env_steps for point in VALUES]
        assert [value for _, value in history[name]] == pytest.approx([point.values[name] for point in VALUES], rel=1e-6)
    assert [value for _, value in history["update"]] == [point.update for point in VALUES]
    assert "episodes/spl" not in history


def test_tensorboard(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("tensorboard", reason="no tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    assert tracking.main([str(run), "--to", "tensorboard", "--out", str(tmp_path / "out")]) == 0
    read = EventAccumulator(str(tmp_path / "out"), size_guidance={"scalars": 0})
    read.Reload()
    check_history({name: [(event.step, event.value) for event in read.Scalars(name)] for name in read.Tags()["scalars"]})


def test_mlflow(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mlflow = pytest.importorskip("mlflow", reason="no mlflow")
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")
    store = (tmp_path / "store").as_uri()
    with tracking.MlflowLogger("rooms", name="first", tracking_uri=store, config={"ppo": {"clip": 0.1}}) as logger:
        assert tracking.log_run(run, logger) == len(VALUES)
        logger.log(99999, {"ppo/loss": math.nan})
    client = mlflow.MlflowClient(store)
    found = client.get_run(logger.run_id)
    assert found.info.status == "FINISHED"
    assert found.data.params == {"ppo.clip": "0.1"}
    history = {name: client.get_metric_history(logger.run_id, name) for name in found.data.metrics}
    check_history({name: [(metric.step, metric.value) for metric in metrics] for name, metrics in history.items()})


def test_wandb(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("wandb", reason="no wandb")
    monkeypatch.setenv("WANDB_SILENT", "true")
    assert tracking.main([str(run), "--to", "wandb", "--mode", "offline", "--out", str(tmp_path), "--project", "rooms"]) == 0
    (file,) = tmp_path.glob("wandb/offline-run-*/run-*.wandb")
    end = time.monotonic() + 60  # another process writes the file, and ends after this one
    while len(wandb_history(file).get("update", ())) < len(VALUES) and time.monotonic() < end:
        time.sleep(0.05)
    check_history(wandb_history(file))


def wandb_records(file: Path) -> Iterator[bytes]:
    """The records of a .wandb file: a log of LevelDB (chunks with checksum, length and kind in blocks of 32 KiB) after seven bytes."""
    data, at, record = file.read_bytes(), 7, b""
    while at + 7 <= len(data):
        if 32768 - at % 32768 < 7:
            at += 32768 - at % 32768
            continue
        _, length, kind = struct.unpack_from("<IHB", data, at)
        record += data[at + 7 : at + 7 + length]
        at += 7 + length
        if kind in (1, 4):  # whole, or the last of several
            yield record
            record = b""


def wandb_history(file: Path) -> dict[str, list[tuple[int, float]]]:
    from wandb.proto import wandb_internal_pb2

    history: dict[str, list[tuple[int, float]]] = {}
    for data in wandb_records(file):
        record = wandb_internal_pb2.Record()  # type: ignore[attr-defined,unused-ignore]
        record.ParseFromString(data)
        if record.WhichOneof("record_type") == "history":
            items = {item.key or ".".join(item.nested_key): json.loads(item.value_json) for item in record.history.item}
            for name, value in items.items():
                history.setdefault(name, []).append((int(items["env_steps"]), value))
    return history


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(ImportError, match=r"needs wandb: pip install 'earshot-rl\[wandb\]'"):
        tracking.WandbLogger("rooms")


def test_a_training_of_the_program(tmp_path: Path) -> None:
    """Followed by another process while it trains; the bits of the file are the values."""
    program = os.environ.get("EARSHOT_PROGRAM")
    if program is None:
        pytest.skip("no program (EARSHOT_PROGRAM)")
    config: dict[str, Any] = {
        "out": str(tmp_path / "run"),
        "envs_per_worker": 2,
        "rollout_steps": 4,
        "total_steps": 24,
        "env": {"observation": {"camera": {"width_px": 64, "height_px": 64}}, "acoustics": {"preset": "fast", "rir_length_s": 0.2}},
        "policy": {"hidden_size": 8, "visual_features": 8, "audio_features": 8, "conv_channels": 4},
        "data": {
            part: {
                "file": str(tmp_path / f"{part}.json.gz"),
                "scenes": ["shoebox:8x3x6"],
                "sounds": ["synth:bird"],
                "filter": {"min_geodesic_m": 1, "min_ratio": 0},
            }
            for part in ("train", "eval")
        },
    }
    path = str(tmp_path / "config.yaml")
    Path(path).write_text(earshot.config.to_yaml(config))
    subprocess.run([program, "dataset", "episodes", "--config", path], stdout=subprocess.DEVNULL, check=True, timeout=120)
    training = subprocess.Popen([program, "train", path], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    found: list[Point] = []
    try:
        found.extend(follow(tmp_path / "run", poll_s=0.02, wait_s=60))
    finally:
        if not found:
            training.kill()
        _, errors = training.communicate(timeout=120)
    assert training.returncode == 0, errors.decode()
    assert [point.env_steps for point in found] == [8, 16, 24]
    assert found == points(tmp_path / "run")
    assert all("episodes/success" not in point.values or 0 <= point.values["episodes/success"] <= 1 for point in found)
    assert not (tmp_path / "run/run.lock").exists()
