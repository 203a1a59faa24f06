# SPDX-License-Identifier: Apache-2.0
"""Corpora, evaluations, sweeps and rollouts on a cluster of Ray, with the bits of one process::

    import earshot.ray

    earshot.ray.corpus("rir", ["configs/datasets/rir.yaml"], out="runs/rir")
    earshot.ray.evaluate("runs/quick", out="runs/quick.json")
    earshot.ray.sweep("configs/sweeps/learning_rate.yaml")

Ray is connected as RAY_ADDRESS says, or started on this machine, unless ``ray.init`` was called before. Parts that are lost with a node
are made again. :func:`corpus`, :func:`evaluate`, :func:`sweep`, :func:`trainable` and :func:`generate` run the program `earshot`, which
the package does not contain: `program=`, the variable EARSHOT_PROGRAM, or the PATH names it. The extra is ``earshot-rl[ray]``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..integrations._common import require

require("ray", "ray")

from .actors import Rollouts, SceneActors, random_actions  # noqa: E402
from .corpora import corpus  # noqa: E402
from .evaluation import evaluate  # noqa: E402

if TYPE_CHECKING:
    from .data import generate, read_corpus
    from .sweeps import sweep, trainable

__all__ = ["Rollouts", "SceneActors", "corpus", "evaluate", "generate", "random_actions", "read_corpus", "sweep", "trainable"]

#: Modules that need ray[data] or ray[tune].
_LATER = {"generate": "data", "read_corpus": "data", "sweep": "sweeps", "trainable": "sweeps"}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"{__name__}.{_LATER[name]}"), name)
