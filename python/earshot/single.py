# SPDX-License-Identifier: Apache-2.0
"""One environment as a gymnasium.Env."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from . import _arguments as check
from . import _rendering
from ._batch import NUM_ACTIONS, Batch, SensorArrays, open_batch
from ._configs import Config, config_text
from ._engine import InputError
from ._episode import Episode, attributes_beside, private_names
from ._seeds import own_sequence

Observation = dict[str, NDArray[Any]]


class EarshotEnv(Episode, gymnasium.Env[Observation, np.int64]):
    """One agent in one scene; make it with earshot.make, or with gymnasium.make and an id of earshot.env_ids.

    Observations are a dict of arrays, copies unless `copy` is False.  Actions: 0 stop, 1 forward, 2 left, 3 right.  The info of the last
    step of an episode holds its metrics, with the names of EarshotVectorEnv.  After the end of an episode call reset.  A batch
    (earshot.make_vec) steps many envs at once and is faster than as many single ones.
    """

    metadata: dict[str, Any] = {"render_modes": list(_rendering.MODES), "render_fps": 7}  # noqa: RUF012

    def __init__(
        self,
        config: Config,
        *,
        render_mode: str | None = None,
        overrides: Sequence[str] = (),
        split: str = "train",
        threads: int | None = None,
        copy: bool = True,
        first_env: int | None = None,
    ) -> None:
        self._batch: Batch | None = None
        self._window: _rendering.Window | None = None
        render_mode = _rendering.check_mode(render_mode, "make")
        copy = check.flag(copy, "make", "copy")
        read = config_text(config, "make")
        lines = check.texts(overrides, "make", "overrides")
        render_keys, hidden = _rendering.rendering_sensors(read[0], lines, render_mode)
        keys = {**render_keys, "autoreset": "off", "threads": threads if threads is None else check.threads(threads, "make")}
        batch = open_batch(read, 1, lines, split, keys, 0 if first_env is None else first_env, "make")
        if batch.num_agents != 1:
            raise InputError(f"agents = {batch.num_agents}: an env has one agent; use earshot.parallel_env")
        self._attach(batch, copy, render_mode, hidden, first_env is None)

    def _attach(self, batch: Batch, copy: bool, render_mode: str | None, hidden: Collection[str], has_own_sequence: bool) -> None:
        self._batch = batch
        self._has_own_sequence = has_own_sequence
        self._window = None
        self.render_mode = render_mode
        self._sensors = SensorArrays(batch, hidden)
        self._copy = copy
        self._rewards = batch.rewards()
        self._terminated = batch.terminated()
        self._truncated = batch.truncated()
        self._quarantined = batch.quarantined()
        self.observation_space: spaces.Space[Any] = self._sensors.space
        self.action_space = spaces.Discrete(NUM_ACTIONS)
        self.metadata = {**type(self).metadata, "render_fps": _rendering.steps_per_second(batch.config_text)}
        self._of_engine = private_names(self)

    def __getstate__(self) -> dict[str, Any]:
        """By the config and the state of the episode, as EarshotVectorEnv, with the attributes that others have set."""
        made = {
            "batch": self.batch,
            "copy": self._copy,
            "render_mode": self.render_mode,
            "hidden": list(self._sensors.hidden_rows),
            "has_own_sequence": self._has_own_sequence,
        }
        return {"made": made, "attributes": attributes_beside(self, self._of_engine)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._attach(**state["made"])
        self.__dict__.update(state["attributes"])

    def __repr__(self) -> str:
        return f"EarshotEnv({'closed' if self._batch is None else ', '.join(self._sensors.names)})"

    @property
    def batch(self) -> Batch:
        """The engine's batch, of one env."""
        if self._batch is None:
            raise RuntimeError("this environment is closed")
        return self._batch

    @property
    def sensor_units(self) -> dict[str, str]:
        return dict(self._sensors.units)

    @property
    def privileged_sensors(self) -> list[str]:
        """Keys of observations that are derived from the goal or the map: no agent could sense them."""
        return list(self._sensors.privileged)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode: the first one of the seed's sequence, or without a seed the next one.  options: not used.

        The first reset without a seed begins the config's sequence.  Later envs of the program that begin without a seed begin sequences
        of their own, unless first_env names one.
        """
        if options is not None and not isinstance(options, Mapping):
            raise TypeError(f"reset: options is {check.shown(options)}; give a dict")
        if seed is not None:
            seed = check.seed(seed, "reset")
        super().reset(seed=seed)
        self.batch.begin([self._seed_of(seed)])
        self._show()
        return self._observation(), {}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Return observation, reward, terminated (stop was called), truncated (out of steps) and info."""
        batch = self.batch
        if isinstance(action, np.ndarray) and action.ndim == 0:
            action = action[()]
        batch._step(np.array([check.integer(action, "step", "action", 0, NUM_ACTIONS - 1)], dtype=np.int32))
        terminated, truncated = bool(self._terminated[0]), bool(self._truncated[0])
        info: dict[str, Any] = {}
        if terminated or truncated:
            for _, _, metrics in batch.finished():
                info.update(metrics)
            if self._quarantined[0]:
                info["quarantined"] = True
        self._show()
        return self._observation(), float(self._rewards[0]), terminated, truncated, info

    def render(self) -> Any:
        """ "rgb_array": a frame [256, 640, 3] with the view of the agent, the floor around it, and the sound at the left and right ear."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() needs a render_mode: earshot.make(config, render_mode='rgb_array')")
            return None
        return self._frame() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Lets go of the batch; its memory goes with the last array that shows it."""
        self._batch = None
        if self._window is not None:
            self._window.close()
            self._window = None

    def _seed_of(self, seed: int | None) -> int | None:
        """The engine's, of that of a reset."""
        if seed is None and self._has_own_sequence and not self.batch.has_started:
            return own_sequence(self.batch.config_text)
        return seed

    def _observation(self) -> Observation:
        return self._sensors.row(0, copy=self._copy)

    def _frame(self) -> NDArray[np.uint8]:
        if not self.batch.has_started:
            raise RuntimeError("render() needs a reset before it")
        return _rendering.draw(self._sensors.all_of_row(0))

    def _show(self) -> None:
        if self.render_mode != "human":
            return
        if self._window is None:
            self._window = _rendering.Window(self.metadata["render_fps"], "Earshot")
        self._window.show(self._frame())
