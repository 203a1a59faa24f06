# SPDX-License-Identifier: Apache-2.0
"""A replay page becomes a Rerun recording with the numbers of the page."""

from __future__ import annotations

import base64
import json
import os
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import earshot
from earshot.integrations import rerun

STEP_S = 0.15


def packed(values: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()


def episode(seed: int, steps: int = 5) -> dict[str, Any]:
    random = np.random.default_rng(seed)
    places = random.uniform(0, 5, (steps, 3)).round(3).tolist()
    return {
        "schema_version": 1,
        "agent": "drawn",
        "episode": {"index": 3, "id": "3", "scene": "<house> & 7"},
        "step_time_s": STEP_S,
        "success_radius_m": 1.0,
        "camera_height_m": 1.25,
        "source_height_m": 1.5,
        "fov_deg": 90.0,
        "goals": [places[-1]],
        "oracle": {"places": places[:2]},
        "sources": [
            {"sound": "bird", "goal": True, "playing": [1, 2], "places": [places[-1]]},
            {"sound": "music", "goal": False, "playing": None, "places": places},
        ],
        "steps": [
            {
                "position": place,
                "heading_deg": float(random.uniform(-180, 180).__round__(1)),
                "reward": float(random.normal()),
                "level_db": random.uniform(-60, 0, 2).round(1).tolist(),
                "value": None if number == 1 else 0.25 * number,
                "probabilities": [0.1, 0.2, 0.3, 0.4],
            }
            for number, place in enumerate(places)
        ],
        "mesh": {
            "low": [-1.0, 0.0, 2.0],
            "size": [4.0, 2.5, 6.0],
            "vertices": packed(random.integers(0, 65536, (7, 3)).astype("<u2")),
            "triangles": packed(random.integers(0, 7, (6, 3)).astype("<u4")),
            "colors": packed(random.integers(0, 256, (6, 3)).astype(np.uint8)),
        },
        "pictures": {
            "width_px": 64,
            "height_px": 48,
            **{kind: [packed(random.bytes(40)) for _ in range(count)] for kind, count in (("rgb", steps), ("depth", steps - seed))},
        },
        "audio": {"mime": "audio/flac", "data": packed(random.bytes(99))},
    }


def page_of(data: dict[str, Any], path: Path) -> Path:
    text = json.dumps(data).replace("<", "\\u003c")
    path.write_text(f'<!DOCTYPE html><script>0</script><script type="application/json" id="episode">{text}</script>', encoding="utf-8")
    return path


def entities(path: Path) -> dict[str, list[dict[str, Any]]]:
    """By entity the rows, by component: read by the SDK's own reader."""
    chunk = pytest.importorskip("rerun.chunk", reason="this rerun-sdk has no reader of recordings")
    found: dict[str, list[dict[str, Any]]] = {}
    for part in chunk.RrdReader(str(path)).stream():
        batch = part.to_record_batch()
        columns = {name: batch.column(name) for name in batch.schema.names if name not in ("rerun.controls.RowId", "log_time", "log_tick")}
        for row in range(batch.num_rows):
            values = {name: column[row].value if name == "episode" else column[row].as_py() for name, column in columns.items()}
            found.setdefault(part.entity_path, []).append(values)
    for rows in found.values():
        rows.sort(key=lambda row: row.get("step") or 0)
    return found


def exported(page: Path, out: Path) -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the SDK warns where it drops a value
        return rerun.export(page, out)


@pytest.mark.parametrize("seed", range(3))
def test_a_recording_has_the_numbers_of_the_page(seed: int, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="no rerun-sdk")
    data = episode(seed)
    assert exported(page_of(data, tmp_path / "page.html"), tmp_path / "out.rrd") == 5
    found = entities(tmp_path / "out.rrd")
    agent = found["/house/agent"]
    assert [row["step"] for row in agent] == list(range(5))
    # A duration of nanoseconds.
    assert [row["episode"] for row in agent] == [pytest.approx(number * STEP_S * 1e9, abs=1) for number in range(5)]
    for row, step in zip(agent, data["steps"], strict=True):
        assert row["Transform3D:translation"] == [pytest.approx(step["position"], abs=1e-5)]
        (turn,) = row["Transform3D:rotation_axis_angle"]
        assert turn["axis"] == [0, 1, 0]
        assert turn["angle"] == pytest.approx(np.radians(step["heading_deg"]), abs=1e-5)
    for name in ("reward", "value"):
        given = [(number, step[name]) for number, step in enumerate(data["steps"]) if step[name] is not None]
        assert [(row["step"], *row["Scalars:scalars"]) for row in found[f"/{name}"]] == given
    assert [row["Scalars:scalars"] for row in found["/level_db/right"]] == [[step["level_db"][1]] for step in data["steps"]]
    for entity, kind in (("/house/agent/camera/rgb", "rgb"), ("/depth", "depth")):
        pictures = [bytes(row["EncodedImage:blob"][0]) for row in found[entity]]
        assert pictures == [base64.b64decode(one) for one in data["pictures"][kind]]
        assert [row["step"] for row in found[entity]] == list(range(len(pictures)))
    (mesh,) = found["/house/mesh"]
    vertices, triangles, _ = rerun.mesh_of(data["mesh"])
    assert np.allclose(mesh["Mesh3D:vertex_positions"], vertices[triangles].reshape(-1, 3), atol=1e-5)
    assert len(found["/house/sources/1"]) == 5
    assert not list(tmp_path.glob("*.partial"))


@pytest.mark.parametrize("seed", range(3))
def test_the_mesh_of_a_page(seed: int) -> None:
    mesh = episode(seed)["mesh"]
    vertices, triangles, colors = rerun.mesh_of(mesh)
    assert (vertices.shape, triangles.shape, colors.shape) == ((7, 3), (6, 3), (6, 3))
    assert (vertices >= np.array(mesh["low"]) - 1e-5).all()
    assert (vertices <= np.add(mesh["low"], mesh["size"]) + 1e-5).all()
    whole = {**mesh, "vertices": packed(np.array([[0, 0, 0], [65535, 65535, 65535]], "<u2"))}
    assert np.allclose(rerun.mesh_of(whole)[0], [mesh["low"], np.add(mesh["low"], mesh["size"])])


def test_what_is_no_page_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "page.html"
    for text, words in (("<html></html>", "is no page of an episode"), ('<script id="episode">{</script>', "cannot be read")):
        path.write_text(text)
        with pytest.raises(earshot.InputError, match=words):
            rerun.read_episode(path)
    page_of({**episode(1), "schema_version": 2}, path)
    with pytest.raises(earshot.InputError, match="has schema_version 2; this package reads 1"):
        rerun.read_episode(path)
    assert rerun.main([str(tmp_path / "none.html"), "--out", str(tmp_path / "out.rrd")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out.rrd").exists()


def test_a_file_that_cannot_be_written_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun", reason="no rerun-sdk")
    out = tmp_path / "none" / "out.rrd"
    assert rerun.main([str(page_of(episode(1), tmp_path / "page.html")), "--out", str(out)]) == 2
    written = capsys.readouterr().err
    assert written.startswith(f"rerun: {out}: cannot be written (")
    assert written.count("\n") == 1


def test_an_episode_of_the_program(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="no rerun-sdk")
    program = os.environ.get("EARSHOT_PROGRAM")
    if program is None:
        pytest.skip("no program (EARSHOT_PROGRAM)")
    result, page = tmp_path / "result.json", tmp_path / "page.html"
    house = ["house:1,rooms=3,area_m2=36", "--sounds", "synth:bird", "--count", "2", "--out", str(tmp_path / "set.json")]
    commands = [
        ["dataset", "episodes", *house],
        ["eval", "greedy", "--episodes", str(tmp_path / "set.json"), "--out", str(result)],
        ["replay", str(result), "--episode", "0", "--html", str(page)],
    ]
    for command in commands:
        done = subprocess.run([program, *command], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr
    data = rerun.read_episode(page)
    assert exported(page, tmp_path / "out.rrd") == len(data["steps"])
    found = entities(tmp_path / "out.rrd")
    assert [row["Scalars:scalars"][0] for row in found["/reward"]] == pytest.approx([step["reward"] for step in data["steps"]])
    assert len(found["/house/agent/camera/rgb"]) == len(data["steps"])
