# SPDX-License-Identifier: Apache-2.0
"""Configs as mappings, dataclasses and OmegaConf structures give the batch of the plain dict."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

import earshot

Make = Callable[..., dict[str, Any]]


@dataclasses.dataclass
class Task:
    max_steps: int = 12
    step_reward: float | None = None  # None: the default of Earshot


@dataclasses.dataclass
class Env:
    episodes: Any
    observation: Any
    acoustics: Any
    seed: Any = dataclasses.field(default_factory=lambda: np.int64(3))
    task: Task = dataclasses.field(default_factory=Task)
    threads: int = 2


def text(config: Any) -> str:
    envs = earshot.make_vec(config, 1)
    return envs.batch.config_text


def test_dataclasses_and_mappings_are_configs(small: Make, tmp_path: Path) -> None:
    config = small()
    expected = text(config)
    assert text(MappingProxyType(config)) == expected
    assert text(Env(config["episodes"], MappingProxyType(config["observation"]), config["acoustics"])) == expected
    config["quarantine_dir"] = tmp_path / "quarantine"
    assert f"quarantine_dir: {tmp_path}" in text(config)


@pytest.mark.parametrize("config", [None, 3, ["a"], Env])
def test_other_things_are_no_configs(config: Any) -> None:
    with pytest.raises(TypeError, match=r"make_vec: config is .*; give a file name, a mapping or an instance of a dataclass"):
        earshot.make_vec(config)


def test_omegaconf_structures_are_configs(small: Make) -> None:
    omegaconf = pytest.importorskip("omegaconf", reason="no omegaconf")
    config = small()
    made = omegaconf.OmegaConf.create({"steps": 12, "env": {**config, "task": {"max_steps": "${steps}"}}})
    assert text(made.env) == text(config)
