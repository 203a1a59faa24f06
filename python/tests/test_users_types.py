# SPDX-License-Identifier: Apache-2.0
"""A script of a user is clean under mypy --strict and pyright's strict mode, and its mistakes are found."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import earshot

SCRIPT = """\
from __future__ import annotations

from pathlib import Path

import numpy as np

import earshot
from earshot.config import Acoustics, EnvConfig, Episodes, RunConfig, to_yaml
from earshot.integrations.runs import follow
from earshot.integrations.tracking import MlflowLogger, log_run

scene = earshot.Scene("house:7", settings=Acoustics(preset="fast", bands=3))
source, listener = scene.random_positions(2, seed=1)
rir = scene.source(source).render(listener, channels="binaural")
peak: float = float(np.abs(rir).max())
t20_s = scene.source(source).response(listener).metrics.t20_s

config = EnvConfig(episodes=Episodes(scenes=["house:1"], sounds=["synth:bird"]))
config.task.motion = "grid"
config.acoustics.rays = 128
envs = earshot.make_vec(config, num_envs=4, threads=0)
observations, infos = envs.reset(seed=1)
observations, rewards, terminations, truncations, infos = envs.step(np.zeros(4, dtype=np.int64))
total: float = float(rewards.sum())

run = RunConfig(total_steps=1000)
Path("run.yaml").write_text(to_yaml(run))
with MlflowLogger("rooms", config=run) as logger:
    logger.log(1, {"loss": 0.5})
    count: int = log_run("runs/quick", logger)
for point in follow("runs/quick"):
    print(point.env_steps, point.values.get("episodes/success"))
"""
#: Each line is one error.
MISTAKES = """
config.task.max_stepz = 3
config.task.motion = "fly"
config.acoustics.rays = "many"
EnvConfig(episode=Episodes())
earshot.make_vec(config, "4")
scene.source(source).render(listener, channel="mono")
"""


def files(folder: Path) -> None:
    (folder / "script.py").write_text(SCRIPT)
    (folder / "mistakes.py").write_text(SCRIPT + MISTAKES)


def wrong_lines(found: list[int]) -> None:
    first = len(SCRIPT.splitlines()) + 2
    assert sorted(set(found)) == list(range(first, first + len(MISTAKES.splitlines()) - 1))


def test_mypy(tmp_path: Path) -> None:
    pytest.importorskip("mypy", reason="no mypy")
    files(tmp_path)
    env = {**os.environ, "MYPYPATH": str(Path(earshot.__file__).parents[1])}

    def check(name: str) -> str:
        command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--cache-dir", str(tmp_path / "cache"), name]
        return subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=600, check=False).stdout

    assert check("script.py").startswith("Success"), check("script.py")
    wrong_lines([int(line.split(":")[1]) for line in check("mistakes.py").splitlines() if ": error:" in line])


def test_pyright(tmp_path: Path) -> None:
    pytest.importorskip("pyright", reason="no pyright")
    files(tmp_path)
    package = str(Path(earshot.__file__).parents[1])
    settings = {"typeCheckingMode": "strict", "extraPaths": [package], "include": ["script.py", "mistakes.py"]}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    command = [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    if not done.stdout.lstrip().startswith("{"):
        pytest.skip(f"pyright cannot be had: {done.stderr.strip().splitlines()[-1:]}")
    errors = [one for one in json.loads(done.stdout)["generalDiagnostics"] if one["severity"] == "error"]
    assert [one for one in errors if one["file"].endswith("script.py")] == []
    wrong_lines([one["range"]["start"]["line"] + 1 for one in errors])
