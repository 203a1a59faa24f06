# SPDX-License-Identifier: Apache-2.0
"""Earshot: agents that see and hear.

Room impulse responses between points of a scene::

    scene = earshot.Scene("house:7")
    source, listener = scene.random_positions(2, seed=1)
    rir = scene.source(source).render(listener, channels="binaural")    # float32 [2, samples]

Batches of audio-visual navigation environments, as a ``gymnasium.vector.VectorEnv``::

    envs = earshot.make_vec({"episodes": {"scenes": ["house:1"], "sounds": ["synth:telephone"]}}, num_envs=8)

numpy is all that this package needs; gymnasium and pettingzoo are imported by the functions that return their classes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _processor  # noqa: F401  # before the engine: raises ImportError where the processor lacks its instructions
from ._engine import InputError, RunError, __version__
from .acoustics import AccuracyChoice, AccuracyPlan, Arrivals, EffectDecision, Metrics, Response, Scene, Source, measure

if TYPE_CHECKING:
    from .multi_agent import EarshotParallelEnv
    from .vector import EarshotVectorEnv

__all__ = [
    "AccuracyChoice",
    "AccuracyPlan",
    "Arrivals",
    "EffectDecision",
    "InputError",
    "Metrics",
    "Response",
    "RunError",
    "Scene",
    "Source",
    "__version__",
    "make_vec",
    "measure",
    "parallel_env",
]


def make_vec(
    config: str | Path | dict[str, Any],
    num_envs: int = 1,
    *,
    overrides: Sequence[str] = (),
    split: str = "train",
    autoreset_mode: str | None = None,
    threads: int | None = None,
    copy: bool = False,
    first_env: int = 0,
) -> EarshotVectorEnv:
    """A batch of environments as a ``gymnasium.vector.VectorEnv`` (needs gymnasium 1.x).

    config: a run config of ``earshot train`` (its sections env and data.SPLIT are used), a YAML file with the keys of an env section and
    ``episodes``, or a dict of the latter.  overrides: "a.b=value" on top.  autoreset_mode: "same_step", "next_step" or "disabled"; default:
    what the config says.  threads: over the batch; 0: all cores; the bits do not depend on it.

    copy: observations are copied.  By default they are views of the engine's own memory, which the next step overwrites.
    first_env: number of the first env, where several batches share a run: each draws episodes of its own.
    """
    from .vector import EarshotVectorEnv

    return EarshotVectorEnv(
        config,
        num_envs,
        overrides=overrides,
        split=split,
        autoreset_mode=autoreset_mode,
        threads=threads,
        copy=copy,
        first_env=first_env,
    )


def parallel_env(
    config: str | Path | dict[str, Any],
    *,
    overrides: Sequence[str] = (),
    split: str = "train",
    threads: int | None = None,
    copy: bool = True,
) -> EarshotParallelEnv:
    """Several agents in one scene as a ``pettingzoo.ParallelEnv`` (needs pettingzoo).

    The number of agents is the key ``agents`` of the config; the other arguments are those of make_vec.  Observations are copies.
    """
    from .multi_agent import EarshotParallelEnv

    return EarshotParallelEnv(config, overrides=overrides, split=split, threads=threads, copy=copy)
