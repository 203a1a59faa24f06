# SPDX-License-Identifier: Apache-2.0
"""Several agents in one scene as a pettingzoo.ParallelEnv."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from . import _arguments as check
from ._batch import NUM_ACTIONS, Batch, SensorArrays, open_batch, require_gymnasium
from ._configs import Config, config_text
from ._engine import InputError
from ._episode import attributes_beside, private_names
from ._seeds import own_sequence

Observation = dict[str, NDArray[Any]]


class EarshotParallelEnv(ParallelEnv[str, Observation, int]):
    """An environment with several agents; create it with :func:`earshot.parallel_env`.

    The agents search for the same goals, hear and see each other, and get separate scores.  An agent that stops leaves ``agents`` but
    stays in the scene as an obstacle.  The episode ends with the last agent.  The infos of the last step hold the metrics of the agents
    in it; the key "ended" holds those of agents that ended earlier.  "quarantined" marks an episode that was faulty; do not train on it.
    """

    metadata: dict[str, Any] = {"name": "earshot_v0", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012

    def __init__(
        self,
        config: Config,
        *,
        overrides: Sequence[str] = (),
        split: str = "train",
        threads: int | None = None,
        copy: bool = True,
        first_env: int | None = None,
    ) -> None:
        require_gymnasium()
        keys = {"autoreset": "off", "threads": threads if threads is None else check.threads(threads, "parallel_env")}
        copy = check.flag(copy, "parallel_env", "copy")
        batch = open_batch(
            config_text(config, "parallel_env"), 1, overrides, split, keys, 0 if first_env is None else first_env, "parallel_env"
        )
        self._attach(batch, copy, first_env is None)

    def _attach(self, batch: Batch, copy: bool, has_own_sequence: bool, agents: Sequence[str] = ()) -> None:
        self._has_own_sequence = has_own_sequence
        self._batch: Batch | None = batch
        self._sensors = SensorArrays(batch)
        self._copy = copy
        self._rewards = batch.rewards()
        self._terminated = batch.terminated()
        self._truncated = batch.truncated()
        self._quarantined = batch.quarantined()
        self._active = batch.active()
        self.render_mode = None
        self.possible_agents = [f"agent_{number}" for number in range(batch.num_agents)]
        self._rows = {agent: row for row, agent in enumerate(self.possible_agents)}
        self._agents = list(agents)
        self._seen_restores = batch.restores
        self._action_spaces = {agent: spaces.Discrete(NUM_ACTIONS) for agent in self.possible_agents}
        self._observation_spaces = {agent: spaces.Dict(dict(self._sensors.space.spaces)) for agent in self.possible_agents}
        self._of_engine = private_names(self) - {"_action_spaces", "_observation_spaces"}  # whose generators may be seeded

    def __getstate__(self) -> dict[str, Any]:
        """By the config and the state of the episode, as EarshotVectorEnv, with the attributes that others have set."""
        made = {"batch": self.batch, "copy": self._copy, "has_own_sequence": self._has_own_sequence, "agents": self.agents}
        return {"made": made, "attributes": attributes_beside(self, self._of_engine)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._attach(**state["made"])
        self.__dict__.update(state["attributes"])

    def __repr__(self) -> str:
        return f"EarshotParallelEnv({'closed' if self._batch is None else f'{len(self.possible_agents)} agents'})"

    @property
    def batch(self) -> Batch:
        if self._batch is None:
            raise RuntimeError("this environment is closed; create a new one")
        return self._batch

    @property
    def agents(self) -> list[str]:
        """The agents that are in the episode.  After a state has been restored, those of it that have not stopped."""
        if self._batch is not None and self._seen_restores != self._batch.restores:
            self._agents = [agent for agent in self.possible_agents if self._active[self._rows[agent]]]
            self._seen_restores = self._batch.restores
        return self._agents

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        self._row(agent, "observation_space")
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        self._row(agent, "action_space")
        return self._action_spaces[agent]

    def _row(self, agent: object, where: str) -> int:
        return self._rows[check.one_of(agent, where, "agent", self.possible_agents)]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin the first episode of the seed's sequence, or without a seed the next episode, as EarshotEnv.  options: not used."""
        if options is not None and not isinstance(options, Mapping):
            raise TypeError(f"reset: options is {check.shown(options)}; give a dict")
        if seed is not None:
            seed = check.seed(seed, "reset")
        batch = self.batch
        if seed is None and self._has_own_sequence and not batch.has_started:
            seed = own_sequence(batch.config_text)
        batch.begin([seed])
        self._agents, self._seen_restores = list(self.possible_agents), batch.restores
        return {agent: self._observation(agent, last=False) for agent in self.agents}, {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, int]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Step all agents.  Actions of agents that have ended are ignored."""
        batch = self.batch
        if not isinstance(actions, Mapping):
            raise TypeError(f"step: actions is {check.shown(actions)}; give a dict with one action per agent")
        acting = self.agents
        if not acting:
            return {}, {}, {}, {}, {}
        missing = [agent for agent in acting if agent not in actions]
        if missing:
            raise InputError(f"step: actions are missing for {', '.join(missing)}; give one action per agent in `agents`")
        row_actions = np.zeros(len(self.possible_agents), dtype=np.int32)
        for agent, action in actions.items():
            row_actions[self._row(agent, "step")] = check.integer(action, "step", f"actions['{agent}']", 0, NUM_ACTIONS - 1)
        batch._step(row_actions)
        terminated = {agent: bool(self._terminated[self._rows[agent]]) for agent in acting}
        truncated = {agent: bool(self._truncated[self._rows[agent]]) for agent in acting}
        rewards = {agent: float(self._rewards[self._rows[agent]]) for agent in acting}
        ended = {agent for agent in acting if terminated[agent] or truncated[agent]}
        observations = {agent: self._observation(agent, last=agent in ended) for agent in acting}
        infos: dict[str, dict[str, Any]] = {agent: {} for agent in acting}
        metrics = {self.possible_agents[number]: values for _, number, values in batch.finished()}
        for agent in acting:
            if agent in metrics:
                infos[agent] = dict(metrics[agent])
                infos[agent]["ended"] = {other: values for other, values in metrics.items() if other not in acting}
            if self._quarantined[self._rows[agent]]:
                infos[agent]["quarantined"] = True
        self._agents = [agent for agent in acting if agent not in ended]
        return observations, rewards, terminated, truncated, infos

    def close(self) -> None:
        self._batch = None

    def _observation(self, agent: str, *, last: bool) -> Observation:
        return self._sensors.row(self._rows[agent], copy=self._copy, last=last)
