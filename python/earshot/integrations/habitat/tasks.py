# SPDX-License-Identifier: Apache-2.0
"""The tasks AudioGoal and SemanticAudioGoal, and their measures.

Success, SPL and SoftSPL are Habitat-Lab's own measures over the distance to the goal.  SNA and SuccessWhenSilent ask the simulator
Earshot-v0, which counts the actions of its oracle and knows when the sound ends; they are 0 until the episode has ended, and
need a task of this module, which tells the simulator to stop.
"""

from __future__ import annotations

from typing import Any

from habitat.core.embodied_task import Measure
from habitat.core.registry import registry
from habitat.sims.habitat_simulator.actions import HabitatSimActions
from habitat.tasks.nav.nav import DistanceToGoal, NavigationTask

STOP = "stop"


@registry.register_task(name="AudioGoal-v0")
class AudioGoalTask(NavigationTask):
    """Walk to the sound, and stop there.

    The simulator takes the action stop as well, so that the last step has a sound of its own.  Where the config has the measure success,
    its distance is that of the simulator too.
    """

    def __init__(self, config: Any, sim: Any, dataset: Any = None) -> None:
        super().__init__(config=config, sim=sim, dataset=dataset)
        if not hasattr(sim, "know"):
            raise TypeError(f"task {config.type} needs the simulator Earshot-v0, not {type(sim).__name__}")
        success = config.measurements.get("success")
        if success is not None:
            sim.set_success_distance(success.success_distance)
        if dataset is not None:
            sim.know(dataset.episodes)

    def _step_single_action(self, action_name: Any, action: dict[str, Any], episode: Any) -> Any:
        observations = super()._step_single_action(action_name, action, episode)
        if observations is None and getattr(self, "is_stop_called", False):
            observations = self._sim.step(HabitatSimActions.stop)
        return observations


@registry.register_task(name="SemanticAudioGoal-v0")
class SemanticAudioGoalTask(AudioGoalTask):
    """The same for sounds that start late and end: the sources of an episode, or its offset and duration, say when."""


for _name, _class in (("AudioNav", AudioGoalTask), ("SemanticAudioNav", SemanticAudioGoalTask)):
    registry.register_task(_class, name=_name)


class _Measure(Measure):
    name = ""

    def __init__(self, sim: Any, config: Any, *args: Any, **kwargs: Any) -> None:
        self._sim = sim
        self._config = config
        super().__init__()

    def _get_uuid(self, *args: Any, **kwargs: Any) -> str:
        return self.name

    def reset_metric(self, *args: Any, **kwargs: Any) -> None:
        self.update_metric(*args, **kwargs)


@registry.register_measure
class EarshotDistanceToGoal(_Measure):
    """Metres on foot to the nearest goal.  Habitat-Lab's DistanceToGoal keeps its last value over moves of less than 0.1 mm."""

    name = DistanceToGoal.cls_uuid

    def update_metric(self, *args: Any, episode: Any, **kwargs: Any) -> None:
        places = [goal.position for goal in episode.goals]
        self._metric = self._sim.geodesic_distance(self._sim.get_agent_state().position, places, episode)


@registry.register_measure
class NormalizedDistanceToGoal(_Measure):
    """The distance to the goal over that of the start."""

    name = "normalized_distance_to_goal"

    def reset_metric(self, *args: Any, task: Any, **kwargs: Any) -> None:
        task.measurements.check_measure_dependencies(self.uuid, [DistanceToGoal.cls_uuid])
        self._start = task.measurements.measures[DistanceToGoal.cls_uuid].get_metric()
        self.update_metric(*args, task=task, **kwargs)

    def update_metric(self, *args: Any, task: Any, **kwargs: Any) -> None:
        distance = task.measurements.measures[DistanceToGoal.cls_uuid].get_metric()
        self._metric = distance / self._start if self._start > 0 else 0.0


class _OfTheSimulator(_Measure):
    """A metric that the engine has at the end of an episode."""

    metric = ""

    def update_metric(self, *args: Any, task: Any = None, **kwargs: Any) -> None:
        metrics = getattr(self._sim, "episode_metrics", None)
        if metrics is None:
            raise TypeError(f"measure {self.uuid} needs the simulator Earshot-v0, not {type(self._sim).__name__}")
        if not metrics and getattr(task, "is_stop_called", False):
            name = type(task).__name__
            raise TypeError(f"measure {self.uuid} needs the task AudioGoal-v0, not {name}, which does not tell the simulator to stop")
        self._metric = metrics.get(self.metric, 0.0)


@registry.register_measure
class SNA(_OfTheSimulator):
    """Success weighted by number of actions: that of the engine's oracle over the agent's."""

    name = metric = "sna"


@registry.register_measure
class SuccessWhenSilent(_OfTheSimulator):
    """Success after the sound of the goal has ended."""

    name = metric = "success_when_silent"


@registry.register_measure
class NumberOfAction(_Measure):
    """Actions so far."""

    name = "number_of_action"

    def reset_metric(self, *args: Any, **kwargs: Any) -> None:
        self._metric = 0

    def update_metric(self, *args: Any, **kwargs: Any) -> None:
        self._metric += 1
