# SPDX-License-Identifier: Apache-2.0
"""The folders of ``earshot dataset grid``: points, graph, responses and pictures (extra ``grid``).

``python -m earshot.integrations.grid DIR`` writes what research code for SoundSpaces 1 reads as pickles: ``graph.pkl`` beside every
``points.txt``, and ``scene_observations/DATASET/SCENE.pkl`` where the program has drawn pictures.

>>> from earshot.integrations.grid import Grid
>>> grid = Grid("out", "mp3d", "house_7")  # doctest: +SKIP
>>> grid.response(receiver=3, source=12, azimuth_deg=90).shape  # doctest: +SKIP
(2, 16000)
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._engine import InputError
from ._common import require

AZIMUTHS = (0, 90, 180, 270)  #: of responses, in degrees clockwise from -z seen from above
HEADINGS = (0, 90, 180, 270)  #: of pictures, counter-clockwise
_PICTURES = (("rgb", "uint8", 3), ("depth", "float32", 1))  # type and channels

Floats = NDArray[np.float64]


def ear_height_m(dataset: str) -> float:
    """Height of the points of ``points.txt`` above the floor, as the published loader has it."""
    return 1.5528907 if dataset == "replica" else 1.5


class Grid:
    """The points of a scene, and the responses between them.

    :param folder: What ``earshot dataset grid`` wrote as ``--out``.
    :raises InputError: The folder holds no such scene, or a file of it is damaged.
    """

    def __init__(self, folder: str | os.PathLike[str], dataset: str, scene: str) -> None:
        self.folder, self.dataset, self.scene = Path(folder), dataset, scene
        self.metadata = self.folder / "metadata" / dataset / scene
        rows = _rows(self.metadata / "points.txt", 4)
        if len(rows) == 0 or not np.array_equal(rows[:, 0], np.arange(len(rows))):
            raise InputError(f"{self.metadata / 'points.txt'}: does not count its points from 0; write the grid again")
        self.points: Floats = np.stack([rows[:, 1], rows[:, 3] - ear_height_m(dataset), -rows[:, 2]], axis=1)  #: [N, 3] on the floor, y up
        edges = _rows(self.metadata / "edges.txt", 2).astype(np.int64)
        if edges.size and not (edges.min() >= 0 and edges.max() < len(rows)):
            raise InputError(f"{self.metadata / 'edges.txt'}: names a point that points.txt does not have; write the grid again")
        self.edges = edges  #: [E, 2] pairs of neighbours between which an agent can walk
        self._arrays: dict[str, _ZarrArray | None] = {}  # by folder; None: its responses are files

    def graph(self) -> Any:
        """A ``networkx.Graph`` whose nodes are the indices of the points, with their places on the floor as ``point``."""
        networkx = require("networkx", "grid")
        graph = networkx.Graph()
        graph.add_nodes_from((index, {"point": tuple(point)}) for index, point in enumerate(self.points.tolist()))
        graph.add_edges_from(self.edges.tolist())
        return graph

    def write_graph(self) -> Path:
        """Write ``graph.pkl`` beside ``points.txt`` and return its path."""
        return _write_pickle(self.metadata / "graph.pkl", self.graph())

    def pictures(self) -> dict[tuple[int, int], dict[str, NDArray[Any]]]:
        """Pictures by (point, heading in degrees): ``rgb`` uint8 [H, W, 3], ``depth`` float32 [H, W, 1], 1 at 10 m; empty without any.

        All of them are in memory at once.

        :raises InputError: A file is damaged, or its pictures have another size than those before.
        """
        found: dict[tuple[int, int], dict[str, NDArray[Any]]] = {}
        size: tuple[int, ...] | None = None
        for point in range(len(self.points)):
            stem = self._pictures_folder / str(point)
            if not Path(f"{stem}.depth.npy").exists():
                continue
            views = {kind: _read_views(Path(f"{stem}.{kind}.npy"), dtype, last) for kind, dtype, last in _PICTURES}
            for kind, view in views.items():
                size = size or view.shape[1:3]
                if view.shape[1:3] != size:
                    raise InputError(
                        f"{stem}.{kind}.npy: has pictures of {view.shape[2]}x{view.shape[1]}, others have {size[1]}x{size[0]}; "
                        "write the pictures again"
                    )
            for index, heading in enumerate(HEADINGS):
                found[point, heading] = {kind: view[index] for kind, view in views.items()}
        return found

    def write_pictures(self) -> Path | None:
        """Write ``scene_observations/DATASET/SCENE.pkl`` and return its path; None without pictures."""
        found = self.pictures()
        if not found:
            return None
        missing = len(HEADINGS) * len(self.points) - len(found)
        if missing:
            raise InputError(f"{self._pictures_folder}: lacks {missing} pictures; complete the grid with the command that began it")
        return _write_pickle(self._pictures_folder.with_name(f"{self.scene}.pkl"), found)

    def response(self, receiver: int, source: int, azimuth_deg: int = 0) -> NDArray[np.float32]:
        """The response [2, samples] of two ears that look along an azimuth of :data:`AZIMUTHS`."""
        if azimuth_deg not in AZIMUTHS:
            raise ValueError(f"Grid.response: azimuth_deg is {azimuth_deg}; give one of {AZIMUTHS}")
        return self._response("binaural_rirs", receiver, source, AZIMUTHS.index(azimuth_deg))

    def ambisonics(self, receiver: int, source: int) -> NDArray[np.float32]:
        """The response [channels, samples] in spherical harmonics, ACN, in the axes of the scene."""
        return self._response("ambisonic_rirs", receiver, source, None)

    @property
    def _pictures_folder(self) -> Path:
        return self.folder / "scene_observations" / self.dataset / self.scene

    def _response(self, kind: str, receiver: int, source: int, azimuth: int | None) -> NDArray[np.float32]:
        for name, index in (("receiver", receiver), ("source", source)):
            if not 0 <= index < len(self.points):
                raise IndexError(f"Grid: {name} is {index}; the grid has points 0 to {len(self.points) - 1}")
        scene = self.folder / kind / self.dataset / self.scene
        if kind not in self._arrays:
            self._arrays[kind] = _ZarrArray(scene / "responses.zarr") if _format(scene / "corpus.json") == "zarr" else None
        array = self._arrays[kind]
        if array is not None:
            of_pair = array.pair(source, receiver)
            return np.array(of_pair if azimuth is None else of_pair[azimuth])
        folder = scene if azimuth is None else scene / str(AZIMUTHS[azimuth])
        return _read_wav(folder / f"{receiver}_{source}.wav")


class _ZarrArray:
    """Of Zarr format 2 without compression, [source, receiver, ...], whose chunks divide the receivers alone."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            meta = json.loads((folder / ".zarray").read_text(encoding="utf-8"))
            self.chunks, self.dtype = tuple(meta["chunks"]), np.dtype(meta["dtype"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{folder}: is no complete array of earshot dataset grid ({error})") from error

    def pair(self, source: int, receiver: int) -> NDArray[np.float32]:
        chunk, index = divmod(receiver, self.chunks[1])
        path = self.folder / ".".join(str(i) for i in (source, chunk, *(0 for _ in self.chunks[2:])))
        try:
            values = np.memmap(path, self.dtype, "r", shape=self.chunks)
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be read as a chunk of the array ({error})") from error
        of_pair: NDArray[np.float32] = values[0, index]
        return of_pair


def _format(corpus: Path) -> str:
    """The ``--format`` that corpus.json states; files in folders without one, as the published ones are."""
    if not corpus.exists():
        return "wav"
    try:
        config: list[str] = json.loads(corpus.read_text(encoding="utf-8"))["config"].splitlines()
        return next(line.removeprefix("format: ") for line in config if line.startswith("format: "))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, StopIteration) as error:
        raise InputError(f"{corpus}: does not state the format of a grid ({error}); write the grid again") from error


def _read_views(path: Path, dtype: str, channels: int) -> NDArray[Any]:
    """[4, H, W, channels], one view per heading."""
    try:
        views = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path}: cannot be read ({error}); write the pictures again") from error
    if views.dtype != dtype or views.ndim != 4 or views.shape[0] != len(HEADINGS) or views.shape[3] != channels:
        raise InputError(
            f"{path}: holds {views.dtype} {list(views.shape)}, not {dtype} [{len(HEADINGS)}, H, W, {channels}]; write the pictures again"
        )
    return np.asarray(views)


def _rows(path: Path, columns: int) -> Floats:
    try:
        rows = np.array([line.split("\t") for line in path.read_text(encoding="utf-8").splitlines()], np.float64)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a table of numbers ({error}); write the grid again") from error
    if rows.size and (rows.ndim != 2 or rows.shape[1] != columns):
        raise InputError(f"{path}: does not have {columns} columns; write the grid again")
    return rows.reshape(-1, columns)


def _read_wav(path: Path) -> NDArray[np.float32]:
    """[channels, samples] of a file of 32-bit floats."""
    try:
        data = path.read_bytes()
        if data[:4] != b"RIFF" or data[8:12] != b"WAVE":
            raise ValueError("it is no WAV file")
        at, channels = 12, 0
        while at + 8 <= len(data):
            name, size = data[at : at + 4], int.from_bytes(data[at + 4 : at + 8], "little")
            if name == b"fmt ":
                channels = int.from_bytes(data[at + 10 : at + 12], "little")
            if name == b"data":
                return np.frombuffer(data, "<f4", size // 4, at + 8).reshape(-1, channels).T.astype(np.float32)
            at += 8 + size + size % 2
        raise ValueError("it holds no samples")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from error


class _Pickler(pickle.Pickler):
    """Writes arrays as calls of ``numpy.ndarray``.  NumPy names a private module, ``numpy._core`` or ``numpy.core`` by its version, which
    other versions cannot load."""

    def reducer_override(self, value: Any) -> Any:
        if type(value) is not np.ndarray or value.dtype.kind not in "fiub":
            return NotImplemented
        return np.ndarray, (value.shape, value.dtype.str, bytearray(value.tobytes()))


def _write_pickle(path: Path, value: Any) -> Path:
    temporary = path.with_name(f"{path.name}.partial{os.getpid()}")
    try:
        with open(temporary, "wb") as file:
            _Pickler(file, protocol=4).dump(value)
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error})") from error
    finally:
        temporary.unlink(missing_ok=True)
    return path


def write_pickles(folder: str | os.PathLike[str]) -> list[Path]:
    """Write ``graph.pkl`` of every scene of the folder, and its pictures as one pickle.  Returns the paths.

    :raises ImportError: The package networkx is missing.
    :raises InputError: The folder holds no scene, a file is damaged or cannot be written.
    """
    scenes = sorted(path.parent for path in Path(folder).glob("metadata/*/*/points.txt"))
    if not scenes:
        raise InputError(f"{folder}: holds no metadata/DATASET/SCENE/points.txt; give a folder of earshot dataset grid")
    written: list[Path] = []
    for scene in scenes:
        grid = Grid(folder, scene.parent.name, scene.name)
        written.append(grid.write_graph())
        pictures = grid.write_pictures()
        if pictures is not None:
            written.append(pictures)
    return written


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m earshot.integrations.grid", description="Write graph.pkl and pickles of pictures for the scenes of a grid."
    )
    parser.add_argument("folder", help="folder that earshot dataset grid wrote")
    options = parser.parse_args(arguments)
    try:
        for path in write_pickles(options.folder):
            print(path)
    except (InputError, ImportError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
