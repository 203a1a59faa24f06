# SPDX-License-Identifier: Apache-2.0
"""An episode as a Rerun recording (extra ``rerun``), out of a page that ``earshot replay`` writes.

``python -m earshot.integrations.rerun best.html --out best.rrd``, then ``rerun best.rrd``.  Time is that of the episode, in seconds, on the
timeline ``episode``; the timeline ``step`` counts observations.

=========================  ============================================================================================
entity                     content
=========================  ============================================================================================
``/house``                 mesh of the storey, y up
``/house/agent``           pose at each step; below it ``camera`` with ``rgb``
``/depth``                 picture of depth at each step (grey: 0 to ``max_depth_m``)
``/house/path``            path so far; ``/house/oracle`` that of the oracle
``/house/goals``           with the radius of a success
``/house/sources/N``       a sound at its place
``/sound``                 both ears as FLAC, where the SDK has ``AssetAudio``
``/level_db/left``, ...    ``reward``, ``walk_m``, ``bearing_deg``, ``heard_deg``, ``value``, ``probability/ACTION`` over time
=========================  ============================================================================================
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

from .._engine import InputError
from ._common import require

ACTIONS = ("stop", "forward", "left", "right")
SCHEMA_VERSION = 1
_EPISODE = re.compile(r'<script[^>]*\bid="episode"[^>]*>(.*?)</script>', re.DOTALL)


def read_episode(page: str | os.PathLike[str]) -> dict[str, Any]:
    """The data of a replay page (docs/howto/replay.md).  Raises InputError for another file."""
    path = Path(page)
    try:
        found = _EPISODE.search(path.read_text(encoding="utf-8"))
        episode: dict[str, Any] = json.loads(found.group(1)) if found else {}
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a page of earshot replay ({error})") from error
    if "steps" not in episode:
        raise InputError(f"{path}: is no page of an episode; write one with earshot replay RESULT --html {path.name}")
    if episode.get("schema_version") != SCHEMA_VERSION:
        raise InputError(f"{path}: has schema_version {episode.get('schema_version')}; this package reads {SCHEMA_VERSION}")
    return episode


def export(page: str | os.PathLike[str], out: str | os.PathLike[str]) -> int:
    """Write the episode of a replay page to an ``.rrd`` file and return the number of observations.

    :raises ImportError: The package rerun-sdk is missing.
    :raises InputError: The page is no page of an episode, or the file cannot be written.
    """
    sdk = require("rerun", "rerun")
    episode = read_episode(page)
    name = f"{episode['agent']}: episode {episode['episode']['id']} in {episode['episode']['scene']}"
    temporary = Path(f"{os.fspath(out)}.partial")
    try:
        with sdk.RecordingStream("earshot", recording_id=Path(out).stem) as stream:
            try:
                stream.save(temporary)
            except RuntimeError as error:  # as the SDK says it of a file
                raise InputError(f"{out}: cannot be written ({error})") from error
            stream.send_recording_name(name)
            _log_place(sdk, stream, episode)
            for number in range(len(episode["steps"])):
                stream.set_time("step", sequence=number)
                stream.set_time("episode", duration=number * episode["step_time_s"])
                _log_step(sdk, stream, episode, number)
        os.replace(temporary, out)
    finally:
        temporary.unlink(missing_ok=True)
    return len(episode["steps"])


def _log_place(sdk: Any, stream: Any, episode: dict[str, Any]) -> None:
    """What does not change, and the sound, which begins with the first observation."""
    vertices, triangles, colors = mesh_of(episode["mesh"])
    stream.log("house", sdk.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    if len(triangles):  # each triangle with corners of its own, for one colour
        corners = vertices[triangles].reshape(-1, 3)
        faces = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
        shades = np.repeat(colors, 3, axis=0)
        stream.log("house/mesh", sdk.Mesh3D(vertex_positions=corners, triangle_indices=faces, vertex_colors=shades), static=True)
    radius = episode["success_radius_m"]
    stream.log("house/goals", sdk.Points3D(episode["goals"], radii=radius, colors=[60, 170, 80, 90]), static=True)
    if len(episode["oracle"]["places"]) > 1:
        stream.log("house/oracle", sdk.LineStrips3D([episode["oracle"]["places"]], colors=[60, 170, 80]), static=True)
    picture = episode["pictures"]
    width, height = picture["width_px"], picture["height_px"]
    focal_px = float(width / 2 / np.tan(np.radians(episode["fov_deg"]) / 2))
    lens = sdk.Pinhole(focal_length=focal_px, width=width, height=height, camera_xyz=sdk.ViewCoordinates.RUB, image_plane_distance=0.5)
    stream.log("house/agent/camera", sdk.Transform3D(translation=[0, episode["camera_height_m"], 0]), lens, static=True)
    stream.set_time("step", sequence=0)
    stream.set_time("episode", duration=0.0)
    if hasattr(sdk, "AssetAudio") and episode["audio"]["data"]:
        sound = episode["audio"]
        stream.log("sound", sdk.AssetAudio(contents=base64.b64decode(sound["data"]), media_type=sound["mime"]))


def _log_step(sdk: Any, stream: Any, episode: dict[str, Any], number: int) -> None:
    step = episode["steps"][number]
    rotation = sdk.RotationAxisAngle(axis=[0, 1, 0], degrees=step["heading_deg"])  # heading 0 faces -z, as the camera does
    stream.log("house/agent", sdk.Transform3D(translation=step["position"], rotation=rotation))
    path = [one["position"] for one in episode["steps"][: number + 1]]
    if len(path) > 1:
        stream.log("house/path", sdk.LineStrips3D([path], colors=[50, 110, 220]))
    for index, source in enumerate(episode["sources"]):
        place = np.add(source["places"][min(number, len(source["places"]) - 1)], [0, episode["source_height_m"], 0])
        playing = source["playing"] is not None and source["playing"][0] <= number <= source["playing"][1]
        color = [230, 140, 30] if source["goal"] else [150, 90, 200]
        shown = [*color, 255 if playing else 60]
        stream.log(f"house/sources/{index}", sdk.Points3D([place], radii=0.12, colors=shown, labels=source["sound"]))
    for kind in ("rgb", "depth"):
        if number < len(episode["pictures"].get(kind, [])):
            data = base64.b64decode(episode["pictures"][kind][number])
            where = "house/agent/camera/rgb" if kind == "rgb" else "depth"
            stream.log(where, sdk.EncodedImage(contents=data, media_type="image/jpeg"))
    for name, value in scalars_of(step).items():
        stream.log(name, sdk.Scalars(value))


def mesh_of(mesh: dict[str, Any]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Vertices [n, 3] in metres, triangles [m, 3], colours [m, 3] of bytes."""
    corners = np.frombuffer(base64.b64decode(mesh["vertices"]), "<u2").reshape(-1, 3)
    vertices = np.asarray(mesh["low"]) + corners / 65535 * np.asarray(mesh["size"])
    triangles = np.frombuffer(base64.b64decode(mesh["triangles"]), "<u4").reshape(-1, 3)
    colors = np.frombuffer(base64.b64decode(mesh["colors"]), np.uint8).reshape(-1, 3)
    return vertices.astype(np.float32), triangles, colors


def scalars_of(step: dict[str, Any]) -> dict[str, float]:
    """The numbers of a step by entity; those that are missing are left out."""
    found = {name: step.get(name) for name in ("reward", "walk_m", "bearing_deg", "heard_deg", "value")}
    found |= {f"level_db/{ear}": level for ear, level in zip(("left", "right"), step.get("level_db", ()), strict=False)}
    found |= {f"probability/{action}": value for action, value in zip(ACTIONS, step.get("probabilities") or (), strict=False)}
    return {name: float(value) for name, value in found.items() if value is not None}


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m earshot.integrations.rerun", description="Write an episode as a Rerun recording.")
    parser.add_argument("page", help="page of the episode, from: earshot replay RESULT --episode N --html PAGE")
    parser.add_argument("--out", required=True, help="file to write (.rrd)")
    options = parser.parse_args(arguments)
    try:
        count = export(options.page, options.out)
    except (InputError, ImportError, OSError) as error:
        print(f"rerun: {error}", file=sys.stderr)
        return 2
    print(f"{options.out}: {count} observations")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
