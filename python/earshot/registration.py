# SPDX-License-Identifier: Apache-2.0
"""Environments by name: what gymnasium.make and gymnasium.make_vec find under "earshot/...".

They are registered when both earshot and gymnasium are imported, in either order.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import sys
import warnings
from collections.abc import Sequence
from types import ModuleType
from typing import Any

_GRID = ("env.task.motion=grid", "env.task.forward_m=1", "env.task.turn_deg=90", "env.task.step_time_s=1", "env.task.max_steps=100")
_DISTRACTOR = ("data.train.scenario.distractors=1", "data.eval.scenario.distractors=1")

#: Arguments of earshot.make by id.  The number after "v" rises with the rules or the episodes; that of a benchmark is its version.
ENVIRONMENTS: dict[str, dict[str, Any]] = {
    "earshot/AudioGoal-v0": {"config": "earshot:train/quick"},
    "earshot/SemanticAudioGoal-v0": {"config": "earshot:train/semantic"},
    "earshot/DistractorAudioGoal-v0": {"config": "earshot:train/quick", "rules": _DISTRACTOR},
    "earshot/GridAudioGoal-v0": {"config": "earshot:train/quick", "rules": _GRID},
    "earshot/QuickBenchmark-v2": {"config": "earshot:benchmarks/quick", "split": "eval"},
    "earshot/SemanticBenchmark-v2": {"config": "earshot:benchmarks/semantic", "split": "eval"},
    "earshot/StandardBenchmark-v2": {"config": "earshot:benchmarks/standard", "split": "eval"},
}


def register_envs() -> None:
    """Registers the ids at gymnasium; importing earshot and gymnasium does this by itself.  A second call changes nothing."""
    from gymnasium.envs.registration import register, registry

    for name, keys in ENVIRONMENTS.items():
        if name not in registry:
            register(
                name,
                entry_point="earshot.registered:RegisteredEnv",
                vector_entry_point="earshot.registered:make_registered_vec",
                kwargs=dict(keys),
            )


def _register_or_warn() -> None:
    """An import of gymnasium or earshot goes on without the ids."""
    try:
        register_envs()
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        warnings.warn(f"earshot: the ids of gymnasium.make are not registered ({reason}); earshot.make works", stacklevel=2)


class _AfterGymnasium(importlib.abc.MetaPathFinder):
    """Registers once gymnasium has been imported; the other finders find it."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        others = (finder.find_spec(fullname, path, target) for finder in sys.meta_path if finder is not self)
        spec = next((found for found in others if found is not None), None)
        if spec is None or spec.loader is None:
            return spec
        execute = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            execute(module)
            if self in sys.meta_path:
                sys.meta_path.remove(self)
            _register_or_warn()

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def register_when_imported() -> None:
    """Now if gymnasium is there, else when it is imported, so that `import earshot` does without it."""
    if "gymnasium" in sys.modules:
        _register_or_warn()
    elif not any(isinstance(finder, _AfterGymnasium) for finder in sys.meta_path):
        sys.meta_path.insert(0, _AfterGymnasium())
