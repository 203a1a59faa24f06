# SPDX-License-Identifier: Apache-2.0
"""Scenes and batches of environments that actors of a cluster hold."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._configs import Config
from .._engine import InputError
from ._tasks import RETRIES, guarded, ray, require_positive, require_room, result_of, start

#: Chooses actions [n] from the observations of a batch, the flags of envs whose episode begins, the numbers of the envs and the step.
Act = Callable[[dict[str, NDArray[Any]], NDArray[np.bool_], NDArray[np.int64], int], ArrayLike]
Rollout = dict[str, Any]


def _actors(kind: type, count: int, cpus: float, arguments: Callable[[int], tuple[Any, ...]]) -> list[Any]:
    """Actors that begin again on another node where theirs is lost, and whose calls are then repeated."""
    remote = ray.remote(num_cpus=cpus, max_restarts=RETRIES, max_task_retries=RETRIES)(kind)
    return [remote.remote(*arguments(number)) for number in range(count)]


class _SceneHolder:
    def __init__(self, spec: Any, keys: dict[str, Any]) -> None:
        self.spec, self.keys = spec, keys
        self.scene: Any = None
        self.source: tuple[Any, Any] = (None, None)

    def render(self, job: tuple[Any, Any], source_keys: dict[str, Any], keys: dict[str, Any]) -> tuple[str, Any]:
        return guarded(self._render, job, source_keys, keys)

    def _render(self, job: tuple[Any, Any], source_keys: dict[str, Any], keys: dict[str, Any]) -> NDArray[np.float32]:
        from ..acoustics import Scene

        if self.scene is None:
            self.scene = Scene(self.spec, **self.keys)
        position, listeners = job
        key = (tuple(map(float, position)), pickle.dumps(sorted(source_keys.items())))
        if self.source[0] != key:
            self.source = (key, self.scene.source(position, **source_keys))
        rir: NDArray[np.float32] = self.source[1].render(listeners, **keys)
        return rir


class SceneActors:
    """A scene held by several actors, which render responses in parallel: the bits of one :class:`earshot.Scene`.

    >>> with earshot.ray.SceneActors("house:7", 4) as scene:                                             # doctest: +SKIP
    ...     for rirs in scene.render([(source, listeners) for source in sources], channels="binaural"):
    ...         print(rirs.shape)
    """

    def __init__(self, spec: str | os.PathLike[str], actors: int, *, cpus_per_actor: int = 1, **scene: Any) -> None:
        """:param scene: Keys of :class:`earshot.Scene`."""
        require_positive("SceneActors", actors=actors, cpus_per_actor=cpus_per_actor)
        start()
        require_room("SceneActors", cpus_per_actor, "cpus_per_actor")
        self.cpus = cpus_per_actor
        self._actors = _actors(_SceneHolder, actors, cpus_per_actor, lambda _: (os.fspath(spec), scene))

    def render(
        self, jobs: Iterable[tuple[ArrayLike, ArrayLike]], *, source: dict[str, Any] | None = None, **keys: Any
    ) -> Iterator[NDArray[np.float32]]:
        """Responses of each job, in the order of the jobs.

        :param jobs: Position of a source, and positions of its listeners [3] or [n, 3]: one call of ``Source.render``. At most four jobs
            per actor are under way.
        :param source: Keys of ``Scene.source``.
        :param keys: Keys of ``Source.render``; `threads` is `cpus_per_actor`.
        """
        if "threads" in keys:
            raise InputError("SceneActors: threads is cpus_per_actor; leave it out")
        keys["threads"] = self.cpus
        waiting: list[Any] = []
        for number, (position, listeners) in enumerate(jobs):
            if len(waiting) >= 4 * len(self._actors):
                yield result_of("SceneActors", waiting.pop(0))
            actor = self._actors[number % len(self._actors)]
            waiting.append(actor.render.remote((np.asarray(position), np.asarray(listeners)), source or {}, keys))
        for reference in waiting:
            yield result_of("SceneActors", reference)

    def close(self) -> None:
        """Ends the actors."""
        for actor in self._actors:
            ray.kill(actor)
        self._actors = []

    def __enter__(self) -> SceneActors:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _BatchHolder:
    def __init__(self, config: Config, first: int, count: int, keys: dict[str, Any]) -> None:
        self.arguments, self.first, self.count = (config, keys), first, count
        self.envs: Any = None

    def collect(self, steps: int, seed: int, act: Act) -> tuple[str, Any]:
        return guarded(self._collect, steps, seed, act)

    def _collect(self, steps: int, seed: int, act: Act) -> Rollout:
        from .. import make_vec

        config, keys = self.arguments
        if self.envs is None:
            self.envs = make_vec(config, self.count, first_env=self.first, autoreset_mode="same_step", copy=True, **keys)
        numbers = np.arange(self.first, self.first + self.count, dtype=np.int64)
        observations, _ = self.envs.reset(seed=[seed + int(number) for number in numbers])
        begins = np.ones(self.count, bool)
        kept: dict[str, list[Any]] = {name: [] for name in observations}
        rows: dict[str, list[Any]] = {name: [] for name in ("begins", "actions", "rewards", "terminations", "truncations")}
        for step in range(steps):
            actions = np.asarray(act(observations, begins, numbers, step), np.int64)
            if actions.shape != (self.count,):
                raise InputError(
                    f"Rollouts: act returned actions of shape {actions.shape}; it must be ({self.count},), one per environment"
                )
            for name, value in observations.items():
                kept[name].append(value)
            rows["begins"].append(begins)
            observations, rewards, ends, cuts, _ = self.envs.step(actions)
            begins = ends | cuts
            for name, value in zip(("actions", "rewards", "terminations", "truncations"), (actions, rewards, ends, cuts), strict=True):
                rows[name].append(value)
        stacked: Rollout = {name: np.stack(values) for name, values in rows.items()}
        stacked["observations"] = {name: np.stack(values) for name, values in kept.items()}
        stacked["last_observations"] = observations
        return stacked


def random_actions(seed: int) -> Act:
    """Actions 1, 2 or 3 (forward, left, right) drawn by seed, environment and step: the same however the batch is split."""

    def act(observations: Any, begins: Any, numbers: NDArray[np.int64], step: int) -> NDArray[np.int64]:
        return np.array([np.random.default_rng([seed, int(number), step]).integers(1, 4) for number in numbers], np.int64)

    return act


class Rollouts:
    """A batch of environments split over actors, which keep their scenes between rollouts.

    A rollout is that of one ``earshot.make_vec`` of all environments, bit for bit, if `act` chooses the action of an environment from
    its own row. A rollout that is lost with a node is played again from its seed.

    >>> with earshot.ray.Rollouts("earshot:train/quick", 64, actors=4) as batch:                          # doctest: +SKIP
    ...     rollout = batch.collect(128, seed=1)
    """

    def __init__(self, config: Config, num_envs: int, *, actors: int, cpus_per_actor: int = 1, **keys: Any) -> None:
        """:param keys: `overrides` and `split` of :func:`earshot.make_vec`."""
        require_positive("Rollouts", num_envs=num_envs, actors=actors, cpus_per_actor=cpus_per_actor)
        if other := sorted(set(keys) - {"overrides", "split"}):
            raise InputError(f"Rollouts: takes no {other[0]}; use overrides or split")
        if actors > num_envs:
            raise InputError(f"Rollouts: {actors} actors for {num_envs} environments; use at most one actor per environment")
        start()
        require_room("Rollouts", cpus_per_actor, "cpus_per_actor")
        bounds = [number * num_envs // actors for number in range(actors + 1)]
        keys["threads"] = cpus_per_actor
        self._actors = _actors(
            _BatchHolder, actors, cpus_per_actor, lambda number: (config, bounds[number], bounds[number + 1] - bounds[number], keys)
        )

    def collect(self, steps: int, *, seed: int, act: Act | None = None) -> Rollout:
        """Plays `steps` steps from ``reset(seed=seed)``, with env i seeded by seed + i.

        :param act: Chooses the actions of an actor's environments: ``act(observations, begins, numbers, step)``; default:
            ``random_actions(seed)``. It travels to the actors.
        :return: Arrays [steps, num_envs, ...]: `observations` (by sensor, before each action), `begins`, `actions`, `rewards`,
            `terminations`, `truncations`; and `last_observations` [num_envs, ...].
        """
        require_positive("Rollouts", steps=steps)
        policy = ray.put(act or random_actions(seed))
        waiting = [actor.collect.remote(steps, seed, policy) for actor in self._actors]
        return _joined([result_of("Rollouts", reference) for reference in waiting])

    def close(self) -> None:
        """Ends the actors."""
        for actor in self._actors:
            ray.kill(actor)
        self._actors = []

    def __enter__(self) -> Rollouts:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _joined(parts: Sequence[Rollout]) -> Rollout:
    whole: Rollout = {}
    for name, first in parts[0].items():
        if isinstance(first, dict):
            axis = 0 if name == "last_observations" else 1
            whole[name] = {sensor: np.concatenate([part[name][sensor] for part in parts], axis) for sensor in first}
        else:
            whole[name] = np.concatenate([part[name] for part in parts], 1)
    return whole
