# SPDX-License-Identifier: Apache-2.0
"""Earshot: agents that see and hear.

Room impulse responses between points of a scene::

    scene = earshot.Scene("house:7")
    source, listener = scene.random_positions(2, seed=1)
    rir = scene.source(source).render(listener, channels="binaural")    # float32 [2, samples]

Batches of audio-visual navigation environments, as a ``gymnasium.vector.VectorEnv``::

    envs = earshot.make_vec({"episodes": {"scenes": ["house:1"], "sounds": ["synth:telephone"]}}, num_envs=8)

The package requires numpy.  :func:`make_vec` also needs gymnasium, :func:`parallel_env` pettingzoo.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import (
    _processor,  # noqa: F401  # before the engine: raises ImportError if the processor lacks its instructions
    _runtime,  # noqa: F401  # forks and the end of the process
)
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
    config: str | Path | Mapping[str, Any],
    num_envs: int = 1,
    *,
    overrides: Sequence[str] = (),
    split: str = "train",
    autoreset_mode: str | None = None,
    threads: int | None = None,
    copy: bool = False,
    first_env: int = 0,
) -> EarshotVectorEnv:
    """Create a batch of environments as a ``gymnasium.vector.VectorEnv`` (needs gymnasium 1.x).

    :param config: A run config of ``earshot train`` (sections ``env`` and ``data.SPLIT``), a YAML file with the keys of an ``env``
        section and ``episodes``, or a dict with the same keys.
    :param num_envs: Number of environments.
    :param overrides: Texts "a.b=value" that replace keys of the config.
    :param split: Part of ``data`` in a run config.
    :param autoreset_mode: "same_step", "next_step" or "disabled"; the default is the mode of the config.
    :param threads: Threads for the batch; 0 uses all cores.  Results do not depend on it.
    :param copy: Return copies of the observations.  By default they are views of the engine's memory, which the next step overwrites.
    :param first_env: Number of the first environment.  Batches that share a run use different numbers and draw different episodes.
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
    config: str | Path | Mapping[str, Any],
    *,
    overrides: Sequence[str] = (),
    split: str = "train",
    threads: int | None = None,
    copy: bool = True,
) -> EarshotParallelEnv:
    """Create an environment with several agents as a ``pettingzoo.ParallelEnv`` (needs pettingzoo).

    The key ``agents`` of the config sets the number of agents.  The arguments are those of :func:`make_vec`, but observations are copies
    by default.
    """
    from .multi_agent import EarshotParallelEnv

    return EarshotParallelEnv(config, overrides=overrides, split=split, threads=threads, copy=copy)
