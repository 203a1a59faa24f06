# SPDX-License-Identifier: Apache-2.0
"""Earshot: agents that see and hear.

Room impulse responses between points of a scene::

    scene = earshot.Scene("house:7")
    source, listener = scene.random_positions(2, seed=1)
    rir = scene.source(source).render(listener, channels="binaural")    # float32 [2, samples]

Batches of audio-visual navigation environments, as a ``gymnasium.vector.VectorEnv``::

    envs = earshot.make_vec({"episodes": {"scenes": ["house:1"], "sounds": ["synth:telephone"]}}, num_envs=8)

A trained agent, without torch::

    actions = earshot.Policy.load("configs/policies/quick.policy").act(observations)

One environment is ``earshot.make(config)``, a ``gymnasium.Env``.  The shipped tasks and benchmarks have ids::

    envs = gymnasium.make_vec("earshot/AudioGoal-v0", num_envs=8)

The package requires numpy.  :func:`make` and :func:`make_vec` also need gymnasium, :func:`parallel_env` pettingzoo.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from . import (
    _processor,  # noqa: F401  # before the engine: raises ImportError if the processor lacks its instructions
    _runtime,  # noqa: F401  # forks and the end of the process
)
from ._configs import Config, packaged_configs
from ._engine import InputError, RunError, __version__
from .acoustics import AccuracyChoice, AccuracyPlan, Arrivals, EffectDecision, Metrics, Response, Scene, Source, measure
from .policy import Policy
from .registration import register_envs, register_when_imported

if TYPE_CHECKING:
    from .multi_agent import EarshotParallelEnv
    from .single import EarshotEnv
    from .vector import EarshotVectorEnv

__all__ = [
    "AccuracyChoice",
    "AccuracyPlan",
    "Arrivals",
    "EffectDecision",
    "InputError",
    "Metrics",
    "Policy",
    "Response",
    "RunError",
    "Scene",
    "Source",
    "__version__",
    "env_ids",
    "make",
    "make_vec",
    "measure",
    "packaged_configs",
    "parallel_env",
    "register_envs",
]

register_when_imported()


def env_ids() -> list[str]:
    """Return the ids of the registered environments, for ``gymnasium.make`` and ``gymnasium.make_vec``."""
    from .registration import ENVIRONMENTS

    return list(ENVIRONMENTS)


def make(
    config: Config,
    *,
    render_mode: str | None = None,
    overrides: Sequence[str] = (),
    split: str = "train",
    threads: int | None = None,
    copy: bool = True,
    first_env: int | None = None,
) -> EarshotEnv:
    """Create one environment as a ``gymnasium.Env`` (needs gymnasium).

    The arguments are those of :func:`make_vec`, but observations are copies by default.

    :param first_env: Without it, environments that begin without a seed draw different episodes: the first one of the program those of
        the config.

    >>> room = {"scenes": ["shoebox:8x3x6"], "sounds": ["synth:bird"], "filter": {"min_geodesic_m": 1, "min_ratio": 0}}
    >>> env = make({"episodes": room})
    >>> observation, info = env.reset(seed=1)
    >>> observation["spectrogram"].shape == env.observation_space["spectrogram"].shape
    True
    """
    from .single import EarshotEnv

    return EarshotEnv(
        config,
        render_mode=render_mode,
        overrides=overrides,
        split=split,
        threads=threads,
        copy=copy,
        first_env=first_env,
    )


def make_vec(
    config: Config,
    num_envs: int = 1,
    *,
    render_mode: str | None = None,
    overrides: Sequence[str] = (),
    split: str = "train",
    autoreset_mode: str | None = None,
    threads: int | None = None,
    copy: bool = False,
    first_env: int = 0,
) -> EarshotVectorEnv:
    """Create a batch of environments as a ``gymnasium.vector.VectorEnv`` (needs gymnasium 1.x).

    :param config: A run config of ``earshot train`` (sections ``env`` and ``data.SPLIT``), a YAML file with the keys of an ``env``
        section and ``episodes``, a mapping with the same keys, or a name of :func:`packaged_configs`.
    :param num_envs: Number of environments.
    :param render_mode: "rgb_array" lets render() return one frame per environment, "human" shows the frames in a window (needs pygame).
        With either mode each step draws the view of every agent.
    :param overrides: Texts "a.b=value" that replace keys of the config.
    :param split: Part of ``data`` in a run config.
    :param autoreset_mode: "same_step", "next_step" or "disabled"; the default is the key ``autoreset`` of the config, without that key
        "next_step", as in gymnasium.
    :param threads: Threads for the batch; 0 uses all cores.  Results do not depend on it.
    :param copy: Return copies of the observations.  By default they are views of the engine's memory, which the next step overwrites.
    :param first_env: Number of the first environment.  Batches that share a run use different numbers and draw different episodes.

    >>> room = {"scenes": ["shoebox:8x3x6"], "sounds": ["synth:bird"], "filter": {"min_geodesic_m": 1, "min_ratio": 0}}
    >>> envs = make_vec({"episodes": room}, 2)
    >>> observations, infos = envs.reset(seed=1)
    >>> observations["depth"].shape
    (2, 128, 128, 1)
    >>> observations, rewards, terminations, truncations, infos = envs.step([1, 2])
    >>> rewards.shape, rewards.dtype
    ((2,), dtype('float32'))
    """
    from .vector import EarshotVectorEnv

    return EarshotVectorEnv(
        config,
        num_envs,
        render_mode=render_mode,
        overrides=overrides,
        split=split,
        autoreset_mode=autoreset_mode,
        threads=threads,
        copy=copy,
        first_env=first_env,
    )


def parallel_env(
    config: Config,
    *,
    overrides: Sequence[str] = (),
    split: str = "train",
    threads: int | None = None,
    copy: bool = True,
    first_env: int | None = None,
) -> EarshotParallelEnv:
    """Create an environment with several agents as a ``pettingzoo.ParallelEnv`` (needs pettingzoo).

    The key ``agents`` of the config sets the number of agents.  The arguments are those of :func:`make`.
    """
    from .multi_agent import EarshotParallelEnv

    return EarshotParallelEnv(config, overrides=overrides, split=split, threads=threads, copy=copy, first_env=first_env)
