# SPDX-License-Identifier: Apache-2.0
"""The folders of earshot dataset grid, read as published code for SoundSpaces 1 reads them.

Needs networkx and EARSHOT_PROGRAM: the program that writes the folders.
"""

from __future__ import annotations

import json
import os
import pickle
import pickletools
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import earshot
from earshot.integrations import grid

networkx = pytest.importorskip("networkx")

ROOM = "shoebox:4.3x3x3.7@0.4"
SHORT = ["--length", "0.1", "--set", "rays=16", "--spacing", "1.2"]


def load_points(file: Path, dataset: str) -> list[tuple[float, float, float]]:
    """What the published loader makes of points.txt: foot points, y up."""
    data = np.loadtxt(file, delimiter="\t")
    height = {"replica": 1.5528907, "mp3d": 1.5}[dataset]
    return list(zip(data[:, 1], data[:, 3] - height, -data[:, 2], strict=True))


@pytest.fixture(scope="module")
def program() -> str:
    found = os.environ.get("EARSHOT_PROGRAM")
    if found is None:
        pytest.skip("EARSHOT_PROGRAM names no program")
    return found


def write(program: str, out: Path, *arguments: str) -> None:
    done = subprocess.run([program, "dataset", "grid", ROOM, "--out", str(out), *SHORT, *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("dataset", "rate"), [("mp3d", 16000), ("replica", 44100)])
def test_published_form(program: str, tmp_path: Path, dataset: str, rate: int) -> None:
    """points.txt by numpy, graph.pkl by pickle, and the paths and shapes of the responses."""
    write(program, tmp_path, "--dataset", dataset, "--name", "room", "--pictures", "16x12")
    metadata = tmp_path / "metadata" / dataset / "room"
    assert grid.main([str(tmp_path)]) == 0
    points = load_points(metadata / "points.txt", dataset)
    with open(metadata / "graph.pkl", "rb") as file:
        graph = pickle.load(file)
    assert list(graph.nodes()) == list(range(len(points)))
    assert len(points) >= 4
    assert networkx.is_connected(graph)
    encode = "{:.2f}_{:.2f}_{:.2f}".format  # by which the published simulator finds the index of a place
    indices = {encode(*graph.nodes()[node]["point"]): node for node in graph.nodes()}
    assert [indices[encode(*point)] for point in points] == list(range(len(points)))
    np.testing.assert_allclose([graph.nodes()[node]["point"] for node in graph.nodes()], points, atol=1e-9)
    floor = np.array(points)[:, 1]
    np.testing.assert_allclose(floor, 0, atol=1e-5)
    for a, b in graph.edges():  # the room is empty: exactly the neighbours
        assert np.linalg.norm(np.subtract(points[a], points[b])) == pytest.approx(1.2, abs=1e-5)
    pairs = [(a, b) for a in range(len(points)) for b in range(a) if abs(np.linalg.norm(np.subtract(points[a], points[b])) - 1.2) < 1e-3]
    assert graph.number_of_edges() == len(pairs)
    for azimuth in (0, 90, 180, 270):
        files = sorted((tmp_path / "binaural_rirs" / dataset / "room" / str(azimuth)).glob("*.wav"))
        assert len(files) == len(points) ** 2
    wav = (tmp_path / "binaural_rirs" / dataset / "room" / "90" / "1_0.wav").read_bytes()
    assert int.from_bytes(wav[20:22], "little") == 3  # IEEE float
    assert int.from_bytes(wav[22:24], "little") == 2
    assert int.from_bytes(wav[24:28], "little") == rate
    with open(tmp_path / "scene_observations" / dataset / "room.pkl", "rb") as file:
        pictures = pickle.load(file)
    assert set(pictures) == {(point, heading) for point in range(len(points)) for heading in (0, 90, 180, 270)}
    assert pictures[0, 90]["rgb"].shape == (12, 16, 3)
    # Ahead at heading 90 degrees is -x: the wall at x = 0, along the view axis.
    np.testing.assert_allclose(pictures[0, 90]["depth"][6, 8, 0], points[0][0] / 10, rtol=1e-3)


def test_azimuths_turn_the_ears(program: str, tmp_path: Path) -> None:
    """The nearer ear is the louder one, by an independent sum: a source to the right of the azimuth at its side."""
    write(program, tmp_path, "--name", "room", "--set", "late=off", "--set", "early=off")
    room = grid.Grid(tmp_path, "mp3d", "room")
    compared = 0
    for receiver in range(len(room.points)):
        for source in range(len(room.points)):
            x, _, z = room.points[source] - room.points[receiver]
            for azimuth in grid.AZIMUTHS:
                clockwise = np.degrees(np.arctan2(x, -z)) - azimuth
                side = np.sin(np.radians(clockwise))
                if receiver == source or abs(side) < 0.5:
                    continue
                left, right = np.sum(room.response(receiver, source, azimuth).astype(np.float64) ** 2, axis=1)
                assert (right > left) == (side > 0)
                compared += 1
    assert compared > 20


def test_array_holds_the_files(program: str, tmp_path: Path) -> None:
    """--format zarr has the samples of the WAV files."""
    for channels, name in (("binaural", "ears"), ("ambisonic:2", "harmonics")):
        write(program, tmp_path / "wav", "--name", name, "--channels", channels)
        write(program, tmp_path / "zarr", "--name", name, "--channels", channels, "--format", "zarr")
        files, array = grid.Grid(tmp_path / "wav", "mp3d", name), grid.Grid(tmp_path / "zarr", "mp3d", name)
        count = len(files.points)
        for receiver, source in ((0, 0), (count - 1, 1), (1, count - 1)):
            if channels == "binaural":
                for azimuth in grid.AZIMUTHS:
                    np.testing.assert_array_equal(files.response(receiver, source, azimuth), array.response(receiver, source, azimuth))
            else:
                assert files.ambisonics(receiver, source).shape == (9, 1600)
                np.testing.assert_array_equal(files.ambisonics(receiver, source), array.ambisonics(receiver, source))


def test_array_by_the_library_zarr(program: str, tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    for channels, kind, of_pair in (("binaural", "binaural_rirs", (4, 2)), ("ambisonic:2", "ambisonic_rirs", (9,))):
        write(program, tmp_path, "--name", "room", "--channels", channels, "--format", "zarr")
        ours = grid.Grid(tmp_path, "mp3d", "room")
        count = len(ours.points)
        opened: Any = zarr.open_array(str(tmp_path / kind / "mp3d" / "room" / "responses.zarr"), mode="r", zarr_format=2)
        assert opened.shape == (count, count, *of_pair, 1600)
        expected = ours.response(1, 2, 180) if channels == "binaural" else ours.ambisonics(1, 2)
        assert np.any(expected)
        np.testing.assert_array_equal(opened[2, 1, 2] if channels == "binaural" else opened[2, 1], expected)


def two_points(folder: Path) -> grid.Grid:
    metadata = folder / "metadata" / "mp3d" / "room"
    metadata.mkdir(parents=True)
    (metadata / "points.txt").write_text("0\t1\t2\t3\n1\t2\t2\t3\n")
    (metadata / "edges.txt").write_text("0\t1\n")
    return grid.Grid(folder, "mp3d", "room")


def write_views(folder: Path, point: int, height: int, width: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    pictures = folder / "scene_observations" / "mp3d" / "room"
    pictures.mkdir(parents=True, exist_ok=True)
    draw = np.random.default_rng([5, point, height, width])
    rgb = draw.integers(0, 256, (4, height, width, 3), np.uint8)
    depth = draw.random((4, height, width, 1), np.float32)
    np.save(pictures / f"{point}.rgb.npy", rgb)
    np.save(pictures / f"{point}.depth.npy", depth)
    return rgb, depth


def test_pickles_name_no_private_module(tmp_path: Path) -> None:
    """Versions of NumPy name their private modules differently, so a pickle with one loads in some versions only."""
    room = two_points(tmp_path)
    views = [write_views(tmp_path, point, 3, 5) for point in range(2)]
    path = room.write_pictures()
    assert path is not None
    data = path.read_bytes()
    strings = {argument for _, argument, _ in pickletools.genops(data) if isinstance(argument, str)}
    assert {"numpy", "ndarray"} <= strings
    assert not [text for text in strings if text.startswith(("numpy.", "numpy._core", "numpy.core"))]
    loaded = pickle.loads(data)
    assert len(loaded) == 8
    for (point, heading), kinds in loaded.items():
        for kind, expected in zip(("rgb", "depth"), views[point], strict=True):
            np.testing.assert_array_equal(kinds[kind], expected[heading // 90])
            assert kinds[kind].dtype == expected.dtype
            assert kinds[kind].flags.writeable
    graph = {argument for _, argument, _ in pickletools.genops(room.write_graph().read_bytes()) if isinstance(argument, str)}
    assert not [text for text in graph if text.startswith("numpy")]


def test_pictures_have_one_size(tmp_path: Path) -> None:
    room = two_points(tmp_path)
    write_views(tmp_path, 0, 3, 5)
    write_views(tmp_path, 1, 5, 3)
    with pytest.raises(earshot.InputError, match=r"1\.rgb\.npy: has pictures of 3x5, others have 5x3"):
        room.pictures()
    rgb, _ = write_views(tmp_path, 1, 3, 5)
    assert len(room.pictures()) == 8
    file = tmp_path / "scene_observations" / "mp3d" / "room" / "1.rgb.npy"
    for damaged in (rgb[:3], rgb[..., :1], rgb.astype(np.float32), rgb[0]):
        np.save(file, damaged)
        with pytest.raises(earshot.InputError, match=r"1\.rgb\.npy: holds"):
            room.pictures()
    file.write_bytes(b"")
    with pytest.raises(earshot.InputError, match=r"1\.rgb\.npy: cannot be read"):
        room.pictures()


def test_an_array_that_was_left_behind_is_not_read(program: str, tmp_path: Path) -> None:
    """What corpus.json states is read, whatever else lies there."""
    write(program, tmp_path, "--name", "room", "--format", "zarr")
    scene = tmp_path / "binaural_rirs" / "mp3d" / "room"
    array = grid.Grid(tmp_path, "mp3d", "room").response(1, 0)
    for name in ("corpus.json", "manifest.jsonl"):
        (scene / name).unlink()
    shutil.rmtree(scene / "parts")
    write(program, tmp_path, "--name", "room", "--set", "early=off")
    assert (scene / "responses.zarr").is_dir()
    files = grid.Grid(tmp_path, "mp3d", "room").response(1, 0)
    assert not np.array_equal(files, array)


def test_an_array_is_opened_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room = two_points(tmp_path)
    array = tmp_path / "binaural_rirs" / "mp3d" / "room" / "responses.zarr"
    array.mkdir(parents=True)
    (array.parent / "corpus.json").write_text(json.dumps({"config": "scene: a\nformat: zarr\n"}))
    (array / ".zarray").write_text(json.dumps({"chunks": [1, 2, 4, 2, 10], "dtype": "<f4"}))
    values = np.arange(160, dtype="<f4")
    (array / "0.0.0.0.0").write_bytes(values.tobytes())
    opened: list[Path] = []

    class Counted(grid._ZarrArray):
        def __init__(self, folder: Path) -> None:
            opened.append(folder)
            super().__init__(folder)

    monkeypatch.setattr(grid, "_ZarrArray", Counted)
    for receiver in (0, 1, 0):
        np.testing.assert_array_equal(room.response(receiver, 0, 90), values.reshape(2, 4, 2, 10)[receiver, 1])
    assert opened == [array]


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    assert grid.main([str(tmp_path)]) == 2
    with pytest.raises(earshot.InputError, match=r"points\.txt"):
        grid.Grid(tmp_path, "mp3d", "room")
    metadata = tmp_path / "metadata" / "mp3d" / "room"
    metadata.mkdir(parents=True)
    (metadata / "points.txt").write_text("0\t1\t2\t3\n1\t2\t2\t3\n")
    (metadata / "edges.txt").write_text("0\t2\n")
    with pytest.raises(earshot.InputError, match="does not have"):
        grid.Grid(tmp_path, "mp3d", "room")
    (metadata / "edges.txt").write_text("0\t1\n")
    room = grid.Grid(tmp_path, "mp3d", "room")
    assert room.graph().nodes[1]["point"] == (2.0, 1.5, -2.0)
    with pytest.raises(earshot.InputError, match=r"1_0\.wav"):
        room.response(1, 0)
    with pytest.raises(IndexError, match="receiver is 2"):
        room.response(2, 0)
    with pytest.raises(ValueError, match="azimuth_deg is 45"):
        room.response(0, 1, 45)
    array = tmp_path / "binaural_rirs" / "mp3d" / "room" / "responses.zarr"
    array.mkdir(parents=True)
    (array.parent / "corpus.json").write_text("{}")
    room = grid.Grid(tmp_path, "mp3d", "room")
    with pytest.raises(earshot.InputError, match="does not state the format"):
        room.response(1, 0)
    (array.parent / "corpus.json").write_text(json.dumps({"config": "scene: a\nformat: zarr\n"}))
    with pytest.raises(earshot.InputError, match="no complete array"):
        room.response(1, 0)
    (array / ".zarray").write_text(json.dumps({"chunks": [1, 2, 4, 2, 10], "dtype": "<f4"}))
    (array / "0.0.0.0.0").write_bytes(bytes(8))
    with pytest.raises(earshot.InputError, match="cannot be read as a chunk"):
        room.response(1, 0)
