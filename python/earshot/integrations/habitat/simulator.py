# SPDX-License-Identifier: Apache-2.0
"""The simulator Earshot-v0 of Habitat-Lab."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gym import spaces
from habitat.core.registry import registry
from habitat.core.simulator import AgentState, Observations, SensorSuite, Simulator
from habitat.sims.habitat_simulator.actions import HabitatSimActions
from numpy.typing import NDArray

from ..._engine import InputError, RunError
from ..._engine_batch import Batch
from ._engine_config import agent_of
from ._floor import Draws, Floor, GreedyFollower, Point, heading_of, rotation_of, triple
from ._worlds import Worlds
from .sensors import OF_KIND, Table

_ACTIONS = {"stop": 0, "move_forward": 1, "turn_left": 2, "turn_right": 3}
_AGENT, _PROBE = 0, 1  #: envs of the batch; the second looks from elsewhere


@registry.register_simulator(name="Earshot-v0")
class EarshotSim(Simulator):
    """One agent that sees and hears.  Places are those of the scene's file, y up, as in habitat_sim.

    Sensors whose array is the same share it.  Actions are stop, move_forward, turn_left and turn_right.  Used by one thread.
    """

    def __init__(self, config: Any) -> None:
        agent_of(config)
        self.habitat_config = config
        self._worlds = Worlds(config)
        self.arrays: Mapping[str, NDArray[Any]] = {}
        self._batch: Batch | None = None
        self._floor: Floor | None = None
        self._episode: Any = None
        self._number = 0
        self._steps = 0
        self._is_over = self._has_just_begun = self._has_collided = False
        self._metrics: dict[str, Any] = {}
        self._draws = Draws(int(config.seed))
        table = self._worlds.table()
        sensors: dict[str, Any] = {}
        for name, kind, array, sensor_config in self._worlds.wanted():
            sensor = OF_KIND[kind](config=sensor_config)
            uuid = name if sensor.uuid in sensors else sensor.uuid  # "rgb" is the first one that draws colours
            sensor.attach(array, uuid, table)
            sensors[uuid] = sensor
        self._sensor_suite = SensorSuite(sensors.values())
        self._action_space = spaces.Discrete(len(_ACTIONS))

    @property
    def sensor_suite(self) -> SensorSuite:
        return self._sensor_suite

    @property
    def action_space(self) -> spaces.Discrete:
        return self._action_space

    def know(self, episodes: Sequence[Any]) -> None:
        """Episodes that will be begun: they are opened together, which is faster.  A task calls it with those of its data set."""
        self._worlds.book.know(episodes)

    def turn_on(self, array: str) -> Table:
        """Turns on an array of the engine, before the first episode; gives the spaces of all that are on."""
        self._worlds.turn_on(array)
        return self._worlds.table()

    def set_success_distance(self, metres: float) -> None:
        """Of a success; before the first episode."""
        self._worlds.success_m = float(metres)

    def reconfigure(self, config: Any, episode: Any = None) -> None:
        """Begins an episode.  Without one it is a walk in config.scene, without a sound, from the start of config or any place."""
        self.habitat_config = config
        self._worlds.config = config
        self._begin(self._worlds.walk(config) if episode is None else episode)
        self._has_just_begun = True

    def _begin(self, episode: Any) -> None:
        number = self._worlds.number_of(episode)
        if number is None:  # first, so that its scenes go before others come
            self._batch = self._floor = self._episode = None
            self.arrays = {}
            self._batch, number = self._worlds.open(episode)
            self.arrays = {name: self._batch.rows(name)[_AGENT] for name, *_ in self._batch.sensors()}
        self._number = number
        self.batch.begin_episode(_AGENT, number)
        if self._floor is None or self._episode is None or self._episode.scene_id != episode.scene_id:
            self._floor = Floor(self.batch.navigation(_AGENT), self._draws)
        self._episode = episode
        self._steps = 0
        self._is_over = self._has_collided = False
        self._metrics = {}

    def reset(self) -> Observations:
        """The episode that reconfigure() has begun, from its start."""
        if self._episode is None:
            self.reconfigure(self.habitat_config)
        elif not self._has_just_begun:
            self._begin(self._episode)
        self._has_just_begun = False
        return self._observations()

    def step(self, action: str | int | None = None, *args: Any, **kwargs: Any) -> Observations:
        """action: a number of HabitatSimActions or its name; None: nothing happens, and no time passes."""
        if action is None:
            return self._observations()
        number = _ACTIONS.get(action, -1) if isinstance(action, str) else int(action)
        if not 0 <= number < len(_ACTIONS):
            raise InputError(f"Earshot-v0: action is {action!r}; it has {', '.join(_ACTIONS)}")
        batch = self.batch
        if self._is_over:
            raise RunError("Earshot-v0: the episode is over, by stop or by its last step; call reset")
        self._has_just_begun = False
        batch.send([_AGENT], [number])
        batch.recv(1, as_sent=True)
        self._steps += 1
        self._has_collided = bool(batch.collided()[_AGENT])
        if batch.quarantined()[_AGENT]:
            self._is_over = True
            raise RunError(f"Earshot-v0: episode {self._episode.episode_id!r} went wrong in step {self._steps}, and has ended")
        self._is_over = bool(batch.terminated()[_AGENT] or batch.truncated()[_AGENT])
        if self._is_over:
            self._metrics = dict(batch.finished()[0][2])
        return self._observations()

    def step_physics(self, delta: float) -> None:
        """Nothing: there are no moving objects."""

    def _observations(self) -> Observations:
        return self._sensor_suite.get_observations(self.arrays)

    @property
    def batch(self) -> Batch:
        """The engine's, of this agent and one that looks from elsewhere."""
        if self._batch is None:
            raise RunError("Earshot-v0: no episode has begun; call reset, or reconfigure with an episode")
        return self._batch

    @property
    def episode_metrics(self) -> dict[str, Any]:
        """The engine's, of an episode that has ended: success, spl, soft_spl, sna, success_when_silent, ...; empty before."""
        return self._metrics

    @property
    def previous_step_collided(self) -> bool:
        return self._has_collided

    def seed(self, seed: int) -> None:
        """Of the navigable points; that of the simulation is habitat.simulator.seed."""
        self._draws.seed(seed)

    def get_agent_state(self, agent_id: int = 0) -> AgentState:
        _first(agent_id)
        x, y, z, heading_rad = self.batch.pose(_AGENT)
        return AgentState(position=np.array([x, y, z]), rotation=rotation_of(heading_rad))

    def set_agent_state(self, position: Point, rotation: Any, agent_id: int = 0, reset_sensors: bool = True) -> bool:
        """Puts the agent on the nearest floor.  False, and nothing moves: none is within 0.5 m, or no way leads to the goal.

        rotation: a quaternion or [x, y, z, w]; its heading counts.
        """
        _first(agent_id)
        if self._is_over:
            raise RunError("Earshot-v0: the episode is over; call reset")
        if not self._place(_AGENT, position, rotation):
            return False
        self._has_collided = self._has_just_begun = False
        return True

    def _place(self, env: int, position: Point, rotation: Any) -> bool:
        try:
            self.batch.place(env, triple(position), heading_of(rotation), min(self._steps, self._worlds.max_steps - 1))
        except InputError:
            return False
        return True

    def get_observations_at(
        self, position: Point | None = None, rotation: Any = None, keep_agent_at_new_pose: bool = False
    ) -> Observations | None:
        """What the agent would see and hear there now, had it stood there; None: it cannot stand there.  The agent does not move."""
        if position is None and rotation is None:
            return self._observations()
        state = self.get_agent_state()
        position = state.position if position is None else position
        rotation = state.rotation if rotation is None else rotation
        if keep_agent_at_new_pose:
            return self._observations() if self.set_agent_state(position, rotation) else None
        self.batch.begin_episode(_PROBE, self._number)
        if not self._place(_PROBE, position, rotation):
            return None
        arrays = {name: self.batch.rows(name)[_PROBE] for name in self.arrays}
        return self._sensor_suite.get_observations(arrays)

    @property
    def pathfinder(self) -> Floor:
        if self._floor is None:
            raise RunError("Earshot-v0: no scene is loaded; call reset, or reconfigure with an episode")
        return self._floor

    def geodesic_distance(self, position_a: Point, position_b: Any, episode: Any = None) -> float:
        """Metres on foot, to the nearest of several places; infinite where no path leads there."""
        return self.pathfinder.geodesic_distance(position_a, position_b)

    def get_straight_shortest_path_points(self, position_a: Point, position_b: Point) -> list[NDArray[np.float64]]:
        return self.pathfinder.shortest_path(position_a, position_b)

    def sample_navigable_point(self) -> list[float]:
        return [float(value) for value in self.pathfinder.get_random_navigable_point()]

    def is_navigable(self, point: Point) -> bool:
        return self.pathfinder.is_navigable(point)

    def make_greedy_follower(
        self,
        agent_id: int = 0,
        goal_radius: float = 0.5,
        *,
        stop_key: Any = HabitatSimActions.stop,
        forward_key: Any = HabitatSimActions.move_forward,
        left_key: Any = HabitatSimActions.turn_left,
        right_key: Any = HabitatSimActions.turn_right,
    ) -> GreedyFollower:
        """For ``habitat.tasks.nav.shortest_path_follower.ShortestPathFollower``, which acts as the engine's oracle does."""
        _first(agent_id)
        return GreedyFollower(self, goal_radius, (stop_key, forward_key, left_key, right_key))

    @property
    def up_vector(self) -> NDArray[np.float64]:
        return np.array([0.0, 1.0, 0.0])

    @property
    def forward_vector(self) -> NDArray[np.float64]:
        return np.array([0.0, 0.0, -1.0])

    def render(self, mode: str = "rgb") -> NDArray[Any]:
        observations = OrderedDict(self._observations())
        if mode not in observations:
            raise InputError(f"Earshot-v0: render mode is {mode!r}; it has the sensors {', '.join(observations)}")
        picture: NDArray[Any] = observations[mode]
        return picture

    def close(self, destroy: bool = True) -> None:
        self._batch = self._floor = self._episode = None
        self.arrays = {}
        self._worlds.close()


def _first(agent_id: int) -> None:
    if agent_id != 0:
        raise InputError(f"Earshot-v0: agent_id is {agent_id}; it has one agent, 0")
