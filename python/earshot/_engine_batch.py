# SPDX-License-Identifier: Apache-2.0
"""The engine's batch, with arguments checked: arrays without a copy, states, steps of some envs in the background."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arguments as check
from . import _engine
from ._engine import InputError
from ._files import require_same

LARGEST_INT = 2**31 - 1


class Batch:
    """Environments that are stepped together.

    One caller at a time: a call from another thread meanwhile raises RunError.  A call that Ctrl-C ends goes on in the background, and the
    next one waits for it.  A batch pickles with the state of its episodes: observations go on with the same bits in another process, which
    refuses files of scenes and sounds that have changed.
    """

    def __init__(
        self,
        yaml: str,
        where: str,
        overrides: Sequence[str],
        env_overrides: Sequence[str],
        split: str,
        num_envs: int,
        first_env: int,
    ) -> None:
        self._recipe = (yaml, where, list(overrides), list(env_overrides), split, num_envs, first_env)
        self._engine = _engine.Batch(*self._recipe)
        self._is_known_to_have_started = False
        self._restores = 0
        self._sensors = {name for name, *_ in self._engine.sensors()}

    def __getstate__(self) -> dict[str, Any]:
        return {"recipe": self._recipe, "state": self._engine.save_state(), "files": self._engine.input_files()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        Batch.__init__(self, *state["recipe"])
        require_same(state["files"], self._engine.input_files(), "the environments were pickled")
        self.restore_state(state["state"])

    def __repr__(self) -> str:
        agents = f" of {self.num_agents} agents" if self.num_agents > 1 else ""
        return f"earshot.Batch({self.num_envs} envs{agents}, autoreset {self.autoreset})"

    @property
    def num_envs(self) -> int:
        return self._engine.num_envs

    @property
    def num_agents(self) -> int:
        """Of each env."""
        return self._engine.num_agents

    @property
    def num_rows(self) -> int:
        """num_envs * num_agents: row = env * num_agents + agent."""
        return self._engine.num_rows

    @property
    def autoreset(self) -> str:
        """same_step, next_step or off."""
        return self._engine.autoreset

    @property
    def config_text(self) -> str:
        """Every key of the env section with its value, as YAML."""
        return self._engine.config_text

    @property
    def has_started(self) -> bool:
        """Whether episodes have begun, by a reset or a restored state.  Asks the engine until they have."""
        if not self._is_known_to_have_started:
            self._is_known_to_have_started = _has_started(self._engine.save_state())
        return self._is_known_to_have_started

    @property
    def restores(self) -> int:
        """How many states and snapshots have been restored."""
        return self._restores

    def begin(self, seeds: Sequence[int | None] = (), mask: NDArray[np.bool_] | None = None) -> None:
        """Begins episodes in the envs of the mask, or in all.

        seeds: one per env, or none.  An env with a seed begins the first episode of that seed's sequence.  One without begins its next
        episode, at the first call of all the first one of the config's sequence.  mask: [num_envs]; before the first call all are True.
        """
        every = np.ones(self.num_envs, dtype=np.bool_) if mask is None else mask
        seeded = every & np.array([value is not None for value in seeds] or np.zeros(self.num_envs), dtype=np.bool_)
        others = every & ~seeded
        values = np.array([0 if value is None else value for value in seeds], dtype=np.uint64)
        if seeded.any() and others.any() and not self.has_started:
            self._engine.reset()  # the engine begins all envs together, those with a seed too
        elif others.any():
            self._engine.reset_masked(others.astype(np.uint8), np.empty(0, dtype=np.uint64))
        if seeded.any():
            self._engine.reset_masked(seeded.astype(np.uint8), values)
        self._is_known_to_have_started = True

    def reset(self) -> None:
        """Begins the first episode of every env."""
        self._engine.reset()
        self._is_known_to_have_started = True

    def reset_masked(self, mask: ArrayLike, seeds: ArrayLike = ()) -> None:
        """Begins episodes in the envs whose flag is not 0.

        mask: [num_envs].  seeds: [num_envs] or none; an env with a seed begins the first episode of that seed's sequence.
        """
        flags = check.array(mask, "Batch.reset_masked", "mask", f"[{self.num_envs}] bools")
        if flags.shape != (self.num_envs,) or flags.dtype.kind not in "biu":
            raise InputError(f"Batch.reset_masked: mask has shape {flags.shape} of {flags.dtype}; give [{self.num_envs}] bools")
        numbers = check.array(seeds, "Batch.reset_masked", "seeds", f"[{self.num_envs}] integers or none")
        if numbers.size == 0:
            values: list[int] = []
        else:
            if numbers.shape != (self.num_envs,):
                raise InputError(f"Batch.reset_masked: seeds have shape {numbers.shape}; give [{self.num_envs}] or none")
            values = [check.seed(value, "Batch.reset_masked", "a seed") for value in numbers]
        self._engine.reset_masked((flags != 0).astype(np.uint8), np.array(values, dtype=np.uint64))
        self._is_known_to_have_started = True

    def step(self, actions: ArrayLike) -> None:
        """actions: [num_rows], integers 0 to 3; those of agents that wait are not used."""
        self._step(check.actions(actions, self.num_rows, "Batch.step"))

    def _step(self, actions: NDArray[np.int32]) -> None:
        """actions: checked by the caller."""
        self._engine.step(actions)

    def send(self, envs: ArrayLike, actions: ArrayLike) -> None:
        """Begins a step of some envs in the background; their rows must not be read until recv hands them back.

        envs: [n], each at most once.  actions: [n * num_agents].
        """
        numbers = check.array(envs, "Batch.send", "envs", "[n] integers")
        if numbers.ndim != 1 or (numbers.size and numbers.dtype.kind not in "iu"):
            raise TypeError(f"Batch.send: envs have shape {numbers.shape} of {numbers.dtype}; give [n] integers")
        if numbers.size and not (numbers.min() >= 0 and numbers.max() < self.num_envs):
            raise InputError(f"Batch.send: envs go from {numbers.min()} to {numbers.max()}; give numbers from 0 to {self.num_envs - 1}")
        rows = check.actions(actions, numbers.size * self.num_agents, "Batch.send")
        self._engine.send(numbers.astype(np.int32), rows)

    def recv(self, min_ready: int, as_sent: bool = False) -> NDArray[np.int32]:
        """Waits until at least `min_ready` envs are done and hands them back, by ascending number.

        as_sent: the first that were sent, the same in every run; else all that are done.  A wait that a signal ends hands nothing back:
        the envs are under way until the next recv.
        """
        least = check.integer(min_ready, "Batch.recv", "min_ready", 1, LARGEST_INT)
        return self._engine.recv(least, check.flag(as_sent, "Batch.recv", "as_sent"))

    def sensors(self) -> list[tuple[str, str, list[int], str, float, float, bool]]:
        """Name, type, shape, units, least and largest value of each sensor, and whether it is privileged."""
        return self._engine.sensors()

    def rows(self, sensor: str) -> NDArray[Any]:
        """Observations [num_rows, ...]: the memory of the batch, which the next step overwrites."""
        return self._engine.rows(self._sensor(sensor, "Batch.rows"))

    def final_rows(self, sensor: str) -> NDArray[Any]:
        """The same of the observations in which the episodes that ended last ended."""
        return self._engine.final_rows(self._sensor(sensor, "Batch.final_rows"))

    def rewards(self) -> NDArray[np.float32]:
        return self._engine.rewards()

    def terminated(self) -> NDArray[np.uint8]:
        """[num_rows], 1: stop was called."""
        return self._engine.terminated()

    def truncated(self) -> NDArray[np.uint8]:
        """[num_rows], 1: out of steps."""
        return self._engine.truncated()

    def active(self) -> NDArray[np.uint8]:
        """[num_rows], 0: idle, or waits for the other agents."""
        return self._engine.active()

    def collided(self) -> NDArray[np.uint8]:
        return self._engine.collided()

    def quarantined(self) -> NDArray[np.uint8]:
        """[num_rows], 1: taken out of the run in the last step; no experience."""
        return self._engine.quarantined()

    def acted(self) -> NDArray[np.uint8]:
        """[num_rows], 0: the step began an episode, or the agent waits."""
        return self._engine.acted()

    def finished(self) -> list[tuple[int, int, dict[str, Any]]]:
        """Env, agent and metrics of each episode that ended in the last step."""
        return self._engine.finished()

    def pose(self, row: int) -> tuple[float, float, float, float]:
        """Foot point in the coordinates of the scene's file, and heading in rad."""
        return self._engine.pose(self._row(row, "Batch.pose"))

    def begin_episode(self, env: int, index: int) -> None:
        """Begins episode number `index` of the set in one env; InputError where it cannot begin."""
        self._engine.begin_episode(
            self._env(env, "Batch.begin_episode"), check.integer(index, "Batch.begin_episode", "index", 0, LARGEST_INT)
        )
        self._is_known_to_have_started = True

    def place(self, env: int, position: Sequence[float], heading_rad: float, steps: int = 0) -> None:
        """Puts the agent of an env on the floor nearest to a foot point and fills its observation, with the sound after `steps` steps.

        The env has one agent, and cannot be saved until its next episode.
        """
        x, y, z = (float(value) for value in position)
        number = check.integer(steps, "Batch.place", "steps", 0, LARGEST_INT)
        self._engine.place(self._env(env, "Batch.place"), x, y, z, float(heading_rad), number)

    def navigation(self, row: int) -> _engine.Navigation:
        """The walkable floor of the scene that the row is in."""
        return self._engine.navigation(self._row(row, "Batch.navigation"))

    def scene_name(self, row: int) -> str:
        return self._engine.scene_name(self._row(row, "Batch.scene_name"))

    def episode_index(self, row: int) -> int:
        return self._engine.episode_index(self._row(row, "Batch.episode_index"))

    def snapshot(self, env: int) -> bytes:
        """State of one env, for any env of any batch with the same set and config."""
        return self._engine.snapshot(self._env(env, "Batch.snapshot"))

    def restore(self, env: int, state: bytes) -> None:
        self._engine.restore(self._env(env, "Batch.restore"), _state(state, "Batch.restore"))
        self._restores += 1

    def save_state(self) -> bytes:
        """State of all running episodes."""
        return self._engine.save_state()

    def restore_state(self, state: bytes) -> None:
        text = _state(state, "Batch.restore_state")
        self._is_known_to_have_started = False  # of a call that fails the engine says what holds
        self._engine.restore_state(text)
        self._is_known_to_have_started = _has_started(text)
        self._restores += 1

    def _row(self, row: int, where: str) -> int:
        return check.integer(row, where, "row", 0, self.num_rows - 1)

    def _env(self, env: int, where: str) -> int:
        return check.integer(env, where, "env", 0, self.num_envs - 1)

    def _sensor(self, sensor: str, where: str) -> str:
        return check.one_of(sensor, where, "sensor", sorted(self._sensors))


def _has_started(state: bytes) -> bool:
    return bool(json.loads(state)["body"]["started"])


def _state(state: bytes, where: str) -> bytes:
    if not isinstance(state, bytes):
        raise TypeError(f"{where}: state is {check.shown(state)}; give the bytes of a snapshot or a saved state")
    return state
