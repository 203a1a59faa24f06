# SPDX-License-Identifier: Apache-2.0
"""Episode sets of two forms, drawn by the tests: Earshot's on a house, and the original's on meshes of their own."""

from __future__ import annotations

import gzip
import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from earshot._engine_batch import Batch
from earshot.integrations import habitat as earshot_habitat

HOUSE = "house:1,rooms=3,area_m2=36"
#: Corners of an L-shaped floor, counter-clockwise seen from above (x, z), in metres.
L_CORNERS = ((0.0, 0.0), (0.0, 7.0), (3.0, 7.0), (3.0, 3.0), (6.0, 3.0), (6.0, 0.0))
L_HEIGHT_M = 2.6


SMALL = [
    "habitat.simulator.agents.main_agent.sim_sensors.depth.width=16",
    "habitat.simulator.agents.main_agent.sim_sensors.depth.height=16",
    "+habitat.simulator.earshot.acoustics.preset=fast",
    "+habitat.simulator.earshot.acoustics.rir_length_s=0.2",
    "+habitat.simulator.earshot.acoustics.field=off",
    "habitat.environment.iterator_options.shuffle=false",
    "habitat.environment.max_episode_steps=150",
]
ENGINE = {
    "autoreset": "off",
    "order": "once",
    "seed": 100,
    "task": {"forward_m": 0.25, "turn_deg": 10, "step_time_s": 0.25, "max_steps": 150},
    "observation": {"camera": {"width_px": 16, "height_px": 16}, "heard": True},
    "acoustics": {"preset": "fast", "rir_length_s": 0.2, "field": "off"},
}


def config_of(path: Path, *overrides: str, task: str = "audiogoal") -> Any:
    return earshot_habitat.get_config([f"habitat.dataset.data_path={path}", *SMALL, *overrides], task)


def engine(path: Path, **keys: Any) -> Batch:
    return Batch(json.dumps({**ENGINE, **keys, "episodes": {"file": str(path)}}), "test", [], [], "train", 1, 0)


def episode(name: str, **keys: Any) -> dict[str, Any]:
    """One in the house, with other values of some keys; sound is that of its info."""
    values: dict[str, Any] = {
        "episode_id": name,
        "scene_id": HOUSE,
        "start_position": [1.0, 0.0, 1.0],
        "start_rotation": [0, 0, 0, 1],
        "goals": [{"position": [2.0, 0.0, 2.0], "radius": 1e-05}],
        "info": {"geodesic_distance": 3.0, "num_action": 9, "sound": keys.pop("sound", "synth:telephone")},
        "start_room": None,
        "shortest_paths": None,
    }
    return {**values, **keys}


def pairs(floor: Any, count: int, seed: int) -> list[tuple[list[float], list[float]]]:
    """Starts and goals at random, 1.5 to 12 m apart on foot."""
    found: list[tuple[list[float], list[float]]] = []
    for draw in range(0, 4000, 2):
        start, goal = floor.random_point(seed, draw), floor.random_point(seed, draw + 1)
        length = floor.distance_m(start, goal)
        if length is not None and 1.5 <= length <= 12:
            found.append((list(start), list(goal)))
        if len(found) == count:
            return found
    raise AssertionError("the scene has too little floor")


def drawn(
    folder: Path, engine: Callable[..., Any], scene: str, count: int, seed: int, file_scene: str | None = None, **keys: Any
) -> list[dict[str, Any]]:
    """Episodes in a scene.  file_scene: its name in the set, where it is another."""
    path = folder / "first.json"
    start = {"start_position": [2.0, 0.0, 1.5], "goals": [{"position": [1.0, 0.0, 1.5]}]} if scene != HOUSE else {}
    if scene == HOUSE:  # any two places will do, as long as they are on the floor
        from earshot import Scene

        places = Scene(scene).random_positions(2, height_m=0.01, seed=3)
        start = {"start_position": places[0].tolist(), "goals": [{"position": places[1].tolist()}]}
    path.write_text(json.dumps({"episodes": [episode("0", scene_id=scene, **start)]}))
    batch = engine(path)
    batch.begin_episode(0, 0)
    rng = np.random.default_rng(seed)
    episodes = []
    for number, (begin, end) in enumerate(pairs(batch.navigation(0), count, seed)):
        angle = float(rng.uniform(0, 2 * math.pi))
        made = episode(str(number), scene_id=file_scene or scene, start_position=begin, goals=[{"position": end, "radius": 1e-05}])
        made["start_rotation"] = [0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)]
        made |= {key: value(number) if callable(value) else value for key, value in keys.items()}
        episodes.append(made)
    path.unlink()
    return episodes


def own_set(folder: Path, engine: Callable[..., Any], **keys: Any) -> Path:
    """JSON of a house with sounds of the engine."""
    path = folder / "own.json"
    path.write_text(json.dumps({"episodes": drawn(folder, engine, HOUSE, 8, 11, **keys)}))
    return path


def original_set(folder: Path, engine: Callable[..., Any]) -> Path:
    """Split by scene, gzip, with the prefix of scenes and sounds named without a folder."""
    content = folder / "v1" / "val" / "content"
    content.mkdir(parents=True)
    (folder / "sounds").mkdir()
    write_tone(folder / "sounds" / "my_ring.wav", 700)
    for number, name in enumerate(("AAAA", "BBBB")):
        mesh = folder / "scenes" / "mp3d" / name / f"{name}.obj"
        mesh.parent.mkdir(parents=True)
        l_shaped_room(mesh, scale=1 + 0.2 * number)
        info = {"geodesic_distance": 5.0, "num_action": 7, "sound": "my_ring"}
        scene = f"data/scene_datasets/mp3d/{name}/{name}.obj"
        episodes = drawn(folder, engine, str(mesh), 4, 20 + number, scene, info=info)
        with gzip.open(content / f"{name}.json.gz", "wt", encoding="utf-8") as file:
            json.dump({"episodes": episodes}, file)
    path = folder / "v1" / "val" / "val.json.gz"
    with gzip.open(path, "wt", encoding="utf-8") as file:
        json.dump({"episodes": []}, file)
    return path


def l_shaped_room(path: Path, scale: float = 1.0, up: str = "y") -> Path:
    """An OBJ of a closed room."""
    corners = [(scale * x, scale * z) for x, z in L_CORNERS]
    places = [(x, height, z) for height in (0.0, L_HEIGHT_M) for x, z in corners]
    lines = [f"v {x} {y} {z}" if up == "y" else f"v {x} {-z} {y}" for x, y, z in places]
    count = len(corners)
    for a in range(count):
        b = (a + 1) % count
        lines.append(f"f {a + 1} {a + 1 + count} {b + 1 + count} {b + 1}")
    for a, b, c, d in ((0, 1, 2, 3), (0, 3, 4, 5)):
        lines.append(f"f {a + 1} {b + 1} {c + 1} {d + 1}")
        lines.append(f"f {d + 1 + count} {c + 1 + count} {b + 1 + count} {a + 1 + count}")
    path.write_text("\n".join(lines) + "\n")
    return path


def write_tone(path: Path, frequency_hz: float, rate_hz: int = 16000) -> None:
    """One second, 16 bits."""
    samples = (8000 * np.sin(2 * np.pi * frequency_hz * np.arange(rate_hz) / rate_hz)).astype("<i2").tobytes()
    form = struct.pack("<HHIIHH", 1, 1, rate_hz, 2 * rate_hz, 2, 16)
    chunks = b"WAVEfmt " + struct.pack("<I", len(form)) + form + b"data" + struct.pack("<I", len(samples)) + samples
    path.write_bytes(b"RIFF" + struct.pack("<I", len(chunks)) + chunks)
