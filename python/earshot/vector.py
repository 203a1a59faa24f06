# SPDX-License-Identifier: Apache-2.0
"""Batches of environments as a gymnasium.vector.VectorEnv."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from . import _arguments as check
from . import _rendering
from ._batch import NUM_ACTIONS, Batch, SensorArrays, open_batch, require_gymnasium
from ._configs import Config, config_text, key_value
from ._engine import InputError
from ._episode import ENV_OF_BATCH_NAMES, EnvOfBatch, attributes_beside, private_names

Observation = dict[str, NDArray[Any]]
Info = dict[str, Any]

MOST_STEPS = 1_000_000  #: of an episode
_ENGINE_MODES = {"same_step": "same_step", "next_step": "next_step", "disabled": "off"}
_MODES = {
    "same_step": AutoresetMode.SAME_STEP,
    "next_step": AutoresetMode.NEXT_STEP,
    "off": AutoresetMode.DISABLED,
}


class EarshotVectorEnv(VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """A vector environment over the C++ batch; create it with :func:`earshot.make_vec`.

    Observations are a dict of arrays [num_envs, ...].  Unless ``copy`` is set, they are views of the engine's memory: the next step
    overwrites them, and the next end of an episode in the same env overwrites its ``final_obs``.  Rewards and flags are always copies.
    Actions are 0 stop, 1 forward, 2 left, 3 right.

    When episodes end, the infos hold their metrics: success, spl, soft_spl, sna, distance_to_goal_m, success_when_silent, episode_return,
    steps, collisions, stopped and episode_index.  Each has its mask under "_" + key.  With autoreset in the same step they are in
    ``final_info``, next to ``final_obs``.  "quarantined" marks envs whose episode was faulty; do not train on it.
    """

    def __init__(
        self,
        config: Config,
        num_envs: int = 1,
        *,
        render_mode: str | None = None,
        overrides: Sequence[str] = (),
        split: str = "train",
        autoreset_mode: str | AutoresetMode | None = None,
        threads: int | None = None,
        copy: bool = False,
        first_env: int = 0,
        max_episode_steps: int | None = None,
    ) -> None:
        require_gymnasium()
        self._batch: Batch | None = None
        self._window: _rendering.Window | None = None
        render_mode = _rendering.check_mode(render_mode, "make_vec")
        mode = _engine_mode(autoreset_mode)
        copy = check.flag(copy, "make_vec", "copy")
        read = config_text(config, "make_vec")
        lines = check.texts(overrides, "make_vec", "overrides")
        if mode is None and key_value(read[0], lines, "autoreset") is None:
            mode = "next_step"  # what Gymnasium's own vector environments do
        render_keys, hidden = _rendering.rendering_sensors(read[0], lines, render_mode)
        if max_episode_steps is not None:
            max_episode_steps = check.integer(max_episode_steps, "make_vec", "max_episode_steps", 1, MOST_STEPS)
        keys = {
            **render_keys,
            "task.max_steps": max_episode_steps,
            "autoreset": mode,
            "threads": threads if threads is None else check.threads(threads, "make_vec"),
        }
        batch = open_batch(read, num_envs, lines, split, keys, first_env)
        if batch.num_agents != 1:
            raise InputError(f"agents = {batch.num_agents}: a vector environment has one agent per env; use earshot.parallel_env")
        self._attach(batch, copy, int(first_env), render_mode, hidden)

    def _attach(self, batch: Batch, copy: bool, first_env: int, render_mode: str | None, hidden: Collection[str]) -> None:
        self._batch = batch
        self._window = None
        self.render_mode = render_mode
        self._sensors = SensorArrays(batch, hidden)
        self._copy = copy
        self._rewards = batch.rewards()
        self._terminated = batch.terminated().view(np.bool_)
        self._truncated = batch.truncated().view(np.bool_)
        self._quarantined = batch.quarantined().view(np.bool_)

        self.num_envs = num_envs = batch.num_envs
        self.first_env = first_env
        self.metadata = {
            "autoreset_mode": _MODES[batch.autoreset],
            "render_modes": list(_rendering.MODES),
            "render_fps": _rendering.steps_per_second(batch.config_text),
        }
        self.single_observation_space = self._sensors.space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.single_action_space = spaces.Discrete(NUM_ACTIONS)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._envs: list[EnvOfBatch] = []
        self._of_engine = private_names(self)

    def __getstate__(self) -> dict[str, Any]:
        """By the config and the state of the episodes: observations go on with the same bits in another process.

        With the attributes that others have set, on the batch and on its envs.
        """
        made = {
            "batch": self.batch,
            "copy": self._copy,
            "first_env": self.first_env,
            "render_mode": self.render_mode,
            "hidden": list(self._sensors.hidden_rows),
        }
        of_envs = [attributes_beside(env, ENV_OF_BATCH_NAMES) for env in self._envs]
        return {"made": made, "attributes": attributes_beside(self, self._of_engine), "of_envs": of_envs}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._attach(**state["made"])
        self.__dict__.update(state["attributes"])
        if state["of_envs"]:
            for env, attributes in zip(self.envs, state["of_envs"], strict=True):
                env.__dict__.update(attributes)

    def __repr__(self) -> str:
        if self._batch is None:
            return "EarshotVectorEnv(closed)"
        return f"EarshotVectorEnv({self.num_envs} envs, {', '.join(self._sensors.names)}, autoreset {self._batch.autoreset})"

    @property
    def batch(self) -> Batch:
        """The batch of the engine: arrays without copies, snapshots, send and recv."""
        if self._batch is None:
            raise RuntimeError("this environment is closed; create a new one with earshot.make_vec")
        return self._batch

    @property
    def envs(self) -> list[EnvOfBatch]:
        """The envs of the batch, one by one; they have what `call` and `get_attr` know."""
        if not self._envs:
            self._envs = [EnvOfBatch(self, row) for row in range(self.num_envs)]
        return self._envs

    @property
    def started(self) -> bool:
        """Whether episodes have begun, by a reset or a restored state."""
        return self.batch.has_started

    @property
    def sensor_units(self) -> dict[str, str]:
        return dict(self._sensors.units)

    @property
    def privileged_sensors(self) -> list[str]:
        """Keys of observations that come from the goal or the map, which a real agent cannot sense."""
        return list(self._sensors.privileged)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, Info]:
        """Begin episodes in all envs, or in those of ``options["reset_mask"]`` (bool [num_envs]).

        :param seed: A number: env i begins the sequence of seed + i.  A list: env i begins the sequence of its entry.  Equal seeds give
            equal episodes in any env of any batch.  None: the first reset begins the sequences of the config, later ones continue them.
        """
        batch = self.batch
        mask = self._reset_mask(options)
        seeds = self._seeds_of(seed)
        if not isinstance(seed, (Sequence, np.ndarray)):
            super().reset(seed=seeds[0])  # the generator of the wrappers; the engine has its own
        batch.begin(seeds, mask)
        return self._begun()

    def step(self, actions: NDArray[Any]) -> tuple[Observation, NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_], Info]:
        batch = self.batch
        batch._step(check.actions(actions, self.num_envs, "step"))
        terminated, truncated = self._terminated.copy(), self._truncated.copy()
        self._show()
        return self._observations(), self._rewards.copy(), terminated, truncated, self._infos(terminated | truncated)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """ "rgb_array": per env a frame [256, 640, 3]: the view of the agent, the floor around it, the sound at the left and right ear."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() needs a render_mode: earshot.make_vec(config, render_mode='rgb_array')")
            return None
        return self._frames() if self.render_mode == "rgb_array" else None

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """The attribute `name` of every env, or what the method of that name returns: pose, scene_name, episode_index, snapshot, render."""
        values = [getattr(env, name) for env in self.envs]
        return tuple(value(*args, **kwargs) if callable(value) else value for value in values)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Gives every env an attribute of this name: one value for all, or a list or tuple with one for each."""
        if not isinstance(values, (list, tuple)):
            values = [values] * self.num_envs
        if len(values) != self.num_envs:
            raise ValueError(f"set_attr({name!r}): {len(values)} values for {self.num_envs} envs")
        for env, value in zip(self.envs, values, strict=True):
            setattr(env, name, value)

    def sensor_row(self, row: int) -> dict[str, NDArray[Any]]:
        """Views of the sensors of one env, with those that a render mode adds."""
        if self.render_mode is None:
            raise RuntimeError("render() needs a render_mode: earshot.make_vec(config, render_mode='rgb_array')")
        if not self.batch.has_started:
            raise RuntimeError("render() needs a reset before it")
        return self._sensors.all_of_row(row)

    def close_extras(self, **_kwargs: Any) -> None:
        """Release the batch; its memory is freed with the last array that views it."""
        self._batch = None
        self._envs = []
        if self._window is not None:
            self._window.close()
            self._window = None

    def __del__(self) -> None:
        self._batch = None

    def _seeds_of(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        """The engine's, one per env, of that of a reset."""
        return check.env_seeds(seed, self.num_envs, "reset")

    def _begun(self) -> tuple[Observation, Info]:
        self._show()
        return self._observations(), {}

    def _frames(self) -> tuple[NDArray[np.uint8], ...]:
        return tuple(_rendering.draw(self.sensor_row(row)) for row in range(self.num_envs))

    def _show(self) -> None:
        if self.render_mode != "human":
            return
        if self._window is None:
            self._window = _rendering.Window(self.metadata["render_fps"], "Earshot")
        self._window.show(_rendering.tile(self._frames()))

    def _observations(self) -> Observation:
        if self._copy:
            return {name: array.copy() for name, array in self._sensors.rows.items()}
        return dict(self._sensors.rows)

    def _infos(self, ended: NDArray[np.bool_]) -> Info:
        infos: Info = {}
        if not ended.any():
            return infos
        metrics: Info = {}
        for env, _, values in self.batch.finished():
            row: int = env - self.first_env
            for key, value in values.items():
                if key not in metrics:
                    metrics[key] = np.zeros(self.num_envs, dtype=type(value))
                    metrics[f"_{key}"] = np.zeros(self.num_envs, dtype=np.bool_)
                metrics[key][row] = value
                metrics[f"_{key}"][row] = True
        if self._quarantined.any():
            infos["quarantined"], infos["_quarantined"] = self._quarantined.copy(), self._quarantined.copy()
        if self.metadata["autoreset_mode"] != AutoresetMode.SAME_STEP:
            return infos | metrics
        final = np.full(self.num_envs, None, dtype=object)
        for row in np.flatnonzero(ended).tolist():
            final[row] = self._sensors.row(row, copy=self._copy, last=True)
        infos["final_obs"], infos["_final_obs"] = final, ended.copy()
        infos["final_info"], infos["_final_info"] = metrics, ended.copy()
        return infos

    def _reset_mask(self, options: Mapping[str, Any] | None) -> NDArray[np.bool_]:
        if options is not None and not isinstance(options, Mapping):
            raise TypeError(f"reset: options is {check.shown(options)}; give a dict")
        if options is None or "reset_mask" not in options:
            return np.ones(self.num_envs, dtype=np.bool_)
        mask = options["reset_mask"]  # not removed from options: wrappers read it too
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            raise TypeError("options['reset_mask'] must be a numpy array of bool")
        if mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(f"options['reset_mask'] must have shape ({self.num_envs},) and at least one True")
        if not self.batch.has_started:
            raise ValueError("options['reset_mask'] needs a reset of all envs first; call reset() without it")
        return mask


def _engine_mode(mode: str | AutoresetMode | None) -> str | None:
    if mode is None:
        return None
    for name, engine in _ENGINE_MODES.items():
        if mode is _MODES[engine] or (isinstance(mode, str) and mode == name):
            return engine
    if not isinstance(mode, (str, AutoresetMode)):
        raise TypeError(f"make_vec: autoreset_mode is {check.shown(mode)}; give a text")
    raise InputError(f"make_vec: autoreset_mode is {check.shown(mode)}; give one of {', '.join(_ENGINE_MODES)}")
