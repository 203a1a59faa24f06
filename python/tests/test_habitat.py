# SPDX-License-Identifier: Apache-2.0
"""Habitat-Lab's own Env, tasks, measures and VectorEnv on the simulator Earshot-v0, against batches of the engine.

Without habitat_sim, its stand-ins are in place.  To run these tests::

    python3.11 -m venv HABITAT && HABITAT/bin/pip install 'numpy<2' habitat-lab pytest nanobind
    cmake --preset ci -DEARSHOT_PYTHON=ON -DPython_EXECUTABLE=HABITAT/bin/python && ninja -C build/release python_package
    PYTHONPATH=build/release/python_package HABITAT/bin/python -m pytest -p no:cacheprovider python/tests/test_habitat.py
"""

from __future__ import annotations

import importlib.util
import itertools
import json
import math
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import earshot

if importlib.util.find_spec("habitat") is None:
    pytest.skip("no habitat-lab", allow_module_level=True)

from habitat_sets import SMALL, config_of, engine, episode, l_shaped_room, original_set, own_set, write_tone

from earshot.integrations import habitat as earshot_habitat

earshot_habitat.standalone()

import habitat  # noqa: E402
from habitat.tasks.nav.shortest_path_follower import ShortestPathFollower  # noqa: E402

#: Of habitat.Env: the engine's.
METRICS = {
    "success": "success",
    "spl": "spl",
    "soft_spl": "soft_spl",
    "sna": "sna",
    "distance_to_goal": "distance_to_goal_m",
    "number_of_action": "steps",
}


def walk(env: Any, choose: Any) -> tuple[list[int], list[Any], dict[str, Any]]:
    """Actions, observations and metrics of one episode."""
    observations = [env.reset()]
    actions = []
    while not env.episode_over:
        actions.append(int(choose(env)))
        observations.append(env.step(actions[-1]))
    return actions, observations, env.get_metrics()


def oracle(env: Any) -> int:
    follower = ShortestPathFollower(env.sim, 0.5, return_one_hot=False)
    nearest = min((goal.position for goal in env.current_episode.goals), key=lambda p: env.sim.geodesic_distance(position(env), p))
    action: int = follower.get_next_action(nearest)
    return action


def position(env: Any) -> Any:
    return env.sim.get_agent_state().position


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return own_set(tmp_path_factory.mktemp("own"), engine)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return original_set(tmp_path_factory.mktemp("original"), engine)


def original_overrides(path: Path) -> list[str]:
    folder = path.parents[2]
    return [f"habitat.dataset.scenes_dir={folder}/scenes", f"+habitat.simulator.earshot.sound_root={folder}/sounds"]


def check_against_engine(env: Any, batch: Any, episodes: int, choose: Any) -> list[dict[str, Any]]:
    """Walks with Habitat-Lab, and the same actions with the engine, whose episodes come in the order of the set."""
    found = []
    for _ in range(episodes):
        actions, observations, metrics = walk(env, choose)
        batch.begin()
        for number, seen in enumerate(observations):
            if number:
                batch.step([actions[number - 1]])
            assert np.array_equal(seen["depth"], batch.rows("depth")[0]), (env.current_episode.episode_id, number)
            assert np.array_equal(seen["spectrogram"], batch.rows("spectrogram")[0])
            assert np.array_equal(seen["audiogoal"], batch.rows("heard")[0])
            assert env.observation_space["spectrogram"].contains(seen["spectrogram"])
        ((_, _, expected),) = batch.finished()
        for name, engine_name in METRICS.items():
            assert metrics[name] == pytest.approx(expected[engine_name], abs=1e-6), (env.current_episode.episode_id, name)
        assert metrics["distance_to_goal_reward"] is not None
        found.append(metrics)
    return found


def test_the_oracle_succeeds_in_a_set_of_ours_and_the_metrics_are_the_engines(own: Path) -> None:
    with habitat.Env(config_of(own).habitat) as env:
        found = check_against_engine(env, engine(own), env.number_of_episodes, oracle)
    assert [metrics["success"] for metrics in found] == [1.0] * len(found)
    assert len(found) >= 8
    assert min(metrics["sna"] for metrics in found) == 1.0  # it walks as the engine's oracle does


def test_the_oracle_succeeds_in_a_set_of_the_originals_form(original: Path) -> None:
    overrides = original_overrides(original)
    with habitat.Env(config_of(original, *overrides).habitat) as env:
        batch = engine(original, scene_root=f"{original.parents[2]}/scenes", sound_root=f"{original.parents[2]}/sounds")
        found = check_against_engine(env, batch, env.number_of_episodes, oracle)
        assert {episode.scene_id for episode in env.episodes} == {
            f"{original.parents[2]}/scenes/mp3d/{n}/{n}.obj" for n in ("AAAA", "BBBB")
        }
    assert [metrics["success"] for metrics in found] == [1.0] * len(found)


def test_metrics_are_the_engines_for_walks_drawn_at_random(own: Path) -> None:
    rng = np.random.default_rng(5)

    def choose(_: Any) -> int:
        return int(rng.choice(4, p=[0.01, 0.6, 0.2, 0.19]))

    with habitat.Env(config_of(own).habitat) as env:
        found = check_against_engine(env, engine(own), env.number_of_episodes, choose)
    assert min(metrics["soft_spl"] for metrics in found) < 0.5  # ends of both kinds
    assert {metrics["success"] for metrics in found} == {0.0}


def test_a_semantic_set_falls_silent_and_counts_success_when_silent(tmp_path: Path) -> None:
    path = own_set(tmp_path, engine, duration=lambda draw: 0.5 if draw % 2 else 60.0, offset=0.25)
    config = config_of(path, task="semantic_audiogoal")
    with habitat.Env(config.habitat) as env:
        for number in range(env.number_of_episodes):
            _, observations, metrics = walk(env, oracle)
            assert metrics["success"] == 1.0
            assert metrics["success_when_silent"] == (1.0 if number % 2 else 0.0)
            assert not observations[0]["audiogoal"].any()  # the onset is at the end of the first step
            assert observations[2]["audiogoal"].any()
            if number % 2 and len(observations) > 10:
                assert np.abs(observations[-1]["audiogoal"]).max() < 0.1 * np.abs(observations[3]["audiogoal"]).max()
        assert observations[0]["rgb"].dtype == np.uint8


def test_places_distances_and_paths(own: Path) -> None:
    with habitat.Env(config_of(own).habitat) as env:
        env.reset()
        sim = env.sim
        sim.seed(7)
        points = [sim.sample_navigable_point() for _ in range(12)]
        sim.seed(7)
        assert points == [sim.sample_navigable_point() for _ in range(12)]
        for start, end in itertools.pairwise(points):
            assert sim.is_navigable(start)
            assert not sim.is_navigable([start[0], start[1] + 0.8, start[2]])
            path = sim.get_straight_shortest_path_points(start, end)
            length = sum(math.hypot(*(b - a)[[0, 2]]) for a, b in itertools.pairwise(path))
            assert sim.geodesic_distance(start, end) == pytest.approx(length, abs=1e-3)
            assert sim.geodesic_distance(start, [points[0], end]) == min(sim.geodesic_distance(start, p) for p in (points[0], end))
        assert not sim.is_navigable([1000.0, 0.0, 0.0])
        assert sim.geodesic_distance(points[0], [1000.0, 0.0, 0.0]) == math.inf
        assert np.isnan(sim.pathfinder.snap_point([1000.0, 0.0, 0.0])).all()


def test_the_agent_is_placed_and_looks_from_elsewhere_without_moving(own: Path) -> None:
    with habitat.Env(config_of(own).habitat) as env:
        first = env.reset()
        sim, start = env.sim, env.sim.get_agent_state()
        for action in (1, 2, 1):
            last = env.step(action)
        rotation = env.current_episode.start_rotation
        there = sim.get_observations_at(env.current_episode.start_position, rotation)
        assert there["depth"] == pytest.approx(first["depth"], abs=1e-5)
        assert np.array_equal(sim.get_observations_at()["audiogoal"], last["audiogoal"])
        assert not np.array_equal(position(env), start.position)  # it has not moved back
        assert sim.get_observations_at([1000.0, 0.0, 0.0], rotation) is None
        goal = env.current_episode.goals[0].position
        assert sim.set_agent_state(goal, [0.0, math.sin(0.3), 0.0, math.cos(0.3)])
        assert position(env)[[0, 2]] == pytest.approx(np.array(goal)[[0, 2]], abs=1e-4)
        assert sim.batch.pose(0)[3] == pytest.approx(0.6)
        assert not sim.set_agent_state([1000.0, 0.0, 0.0], rotation)
        env.step("stop")
        assert env.get_metrics()["success"] == 1.0
        assert env.get_metrics()["distance_to_goal"] < 1e-3


def test_the_same_seed_gives_the_same_observations_and_reset_begins_again(own: Path) -> None:
    config = config_of(own).habitat
    walks = []
    for _ in range(2):
        with habitat.Env(config) as env:
            walks.append([walk(env, oracle)[1] for _ in range(2)])
    for one, other in zip(walks[0], walks[1], strict=True):
        assert all(np.array_equal(a["audiogoal"], b["audiogoal"]) for a, b in zip(one, other, strict=True))
    with habitat.Env(config) as env:
        begun = env.reset()
        env.step(1)
        env.current_episode = env.current_episode  # the same once more
        assert np.array_equal(env.reset()["audiogoal"], begun["audiogoal"])
        assert np.array_equal(env.sim.reset()["depth"], begun["depth"])


VECTOR = """
    import sys
    from earshot.integrations import habitat as earshot_habitat

    earshot_habitat.standalone()
    import json
    import habitat
    from habitat.config import read_write

    def main() -> None:
        config = earshot_habitat.get_config(json.loads(sys.argv[1]))
        with habitat.Env(config.habitat) as single:
            expected = [single.reset()] + [single.step(action) for action in (1, 2, 3, 1)]
        with habitat.VectorEnv(make_env_fn=earshot_habitat.make_env, env_fn_args=[(config,)] * 2) as envs:
            found = [envs.reset()]
            for action in (1, 2, 3, 1):
                steps = envs.step([action] * 2)
                found.append([step[0] for step in steps])
                assert all(step[3]["number_of_action"] == len(found) - 1 for step in steps)
            assert envs.num_envs == 2
            for observations, seen in zip(expected, found):
                for env in range(2):
                    assert seen[env].keys() == observations.keys()
                    assert all((seen[env][name] == observations[name]).all() for name in observations)
        print("equal", sorted(expected[0]))

    if __name__ == "__main__":
        main()
"""


def test_two_environments_in_processes_of_their_own(own: Path, tmp_path: Path) -> None:
    script = tmp_path / "vector.py"
    script.write_text(textwrap.dedent(VECTOR))
    overrides = [f"habitat.dataset.data_path={own}", *SMALL]
    done = subprocess.run([sys.executable, script, json.dumps(overrides)], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "equal ['audiogoal', 'depth', 'spectrogram']" in done.stdout


CAMERAS = {"rgb_sensor": "rgb_sensor", "semantic_sensor": "semantic_sensor", "round": "equirect_depth_sensor"}


def test_cameras_of_habitat_and_sensors_of_a_task_work_too(own: Path) -> None:
    sensors = "habitat/simulator/sim_sensors@habitat.simulator.agents.main_agent.sim_sensors"
    overrides = [f"+{sensors}.{name}={kind}" for name, kind in CAMERAS.items()]
    overrides += [
        f"+{sensors}.metres=earshot_depth",
        "+habitat/task/lab_sensors=[earshot_audiogoal_sensor,pointgoal_with_gps_compass_sensor]",
    ]
    place = "habitat.simulator.agents.main_agent.sim_sensors"
    overrides += [f"~{sensors}.audiogoal", f"{place}.metres.normalize_depth=false", f"{place}.metres.width=16", f"{place}.metres.height=16"]
    overrides += [f"{place}.metres.max_depth=3.0", f"{place}.metres.min_depth=0.5"]
    overrides += [f"{place}.round.width=32", f"{place}.round.height=16"]
    for name in ("rgb_sensor", "semantic_sensor"):
        overrides += [f"{place}.{name}.width=24", f"{place}.{name}.height=16", f"{place}.{name}.position=[0.1,1.0,0.2]"]
    with habitat.Env(config_of(own, *overrides).habitat) as env:
        seen = env.reset()
        assert sorted(seen) == ["audiogoal", "depth", "metres", "pointgoal_with_gps_compass", "rgb", "round", "semantic", "spectrogram"]
        assert seen["round"].shape == (16, 32, 1)
        ahead = seen["depth"][8, 8, 0] - seen["round"][8, 16, 0]
        assert abs(ahead) < 0.03  # the middle of both pictures
        for name, array in seen.items():
            assert env.observation_space[name].contains(array), name
        assert seen["rgb"].shape == (16, 24, 3)
        assert seen["semantic"].shape == (16, 24, 1)
        assert seen["metres"] == pytest.approx(np.clip(seen["depth"] * 10, 0.5, 3.0), abs=1e-4)
        start = np.array(env.current_episode.start_position)
        straight = np.linalg.norm(np.array(env.current_episode.goals[0].position) - start)
        assert seen["pointgoal_with_gps_compass"][0] == pytest.approx(straight, abs=0.05)


def test_episodes_made_by_hand_and_walks_without_a_data_set(own: Path, tmp_path: Path) -> None:
    room = l_shaped_room(tmp_path / "room.obj")
    config = config_of(own, f"habitat.simulator.scene={room}")
    sim = habitat.sims.make_sim("Earshot-v0", config=config.habitat.simulator)
    first = sim.reset()
    assert first["depth"].shape == (16, 16, 1)
    assert sim.geodesic_distance(sim.sample_navigable_point(), sim.sample_navigable_point()) < 30
    sim.step("move_forward")
    sim.close()
    with habitat.Env(config.habitat) as env:
        env.reset()
        goal = env.current_episode.goals[0].position
        env.current_episode = env.current_episode  # as users change an episode in place
        env.current_episode.start_position = list(env.sim.sample_navigable_point())
        env.reset()
        assert position(env)[[0, 2]] == pytest.approx(np.array(env.current_episode.start_position)[[0, 2]], abs=1e-4)
        assert env.get_metrics()["distance_to_goal"] == pytest.approx(env.sim.geodesic_distance(position(env), goal))


def test_meshes_with_another_upward_axis_are_the_same_rooms(original: Path) -> None:
    overrides = original_overrides(original)
    scenes = original.parents[2] / "scenes" / "mp3d"
    with habitat.Env(config_of(original, *overrides).habitat) as env:
        expected = [walk(env, oracle) for _ in range(2)]
    for number, name in enumerate(("AAAA", "BBBB")):
        l_shaped_room(scenes / name / f"{name}.obj", scale=1 + 0.2 * number, up="z")
    with habitat.Env(config_of(original, *overrides, "habitat.simulator.mesh='up=z'").habitat) as env:
        found = [walk(env, oracle) for _ in range(2)]
    for number, name in enumerate(("AAAA", "BBBB")):
        l_shaped_room(scenes / name / f"{name}.obj", scale=1 + 0.2 * number)
    for one, other in zip(expected, found, strict=True):
        assert one[0] == other[0]
        assert other[2]["success"] == 1.0
        assert all(a["depth"] == pytest.approx(b["depth"], abs=1e-4) for a, b in zip(one[1], other[1], strict=True))


def test_steps_after_the_end_and_wrong_actions_are_refused(own: Path) -> None:
    with habitat.Env(config_of(own).habitat) as env:
        with pytest.raises(earshot.RunError, match="no episode has begun"):
            env.sim.get_agent_state()
        env.reset()
        with pytest.raises(earshot.InputError, match=r"action is 'fly'; it has stop, move_forward"):
            env.sim.step("fly")
        env.step("stop")
        with pytest.raises(earshot.RunError, match="the episode is over"):
            env.sim.step(1)
        with pytest.raises(earshot.RunError, match="the episode is over"):
            env.sim.set_agent_state(position(env), [0, 0, 0, 1])
        assert env.sim.get_observations_at(position(env), [0, 0, 0, 1]) is not None
        assert env.get_metrics()["number_of_action"] == 1


def test_what_is_not_installed_says_so() -> None:
    if importlib.util.find_spec("habitat_sim") is not None and "_standins" not in str(sys.modules["habitat_sim"].__loader__):
        pytest.skip("habitat_sim is installed")
    import habitat_sim
    import magnum

    for used in (habitat_sim.Simulator, habitat_sim.nav.NavMeshSettings, magnum.Vector3):
        with pytest.raises(ImportError, match="is not installed, and Earshot replaces no part of it"):
            used()
    config = earshot_habitat.get_config().habitat.simulator
    with pytest.raises(ImportError, match="habitat_sim is not installed"):
        habitat.sims.make_sim("Sim-v0", config=config)


def test_tones_are_heard_from_the_folder_of_sounds(tmp_path: Path) -> None:
    (tmp_path / "sounds").mkdir()
    write_tone(tmp_path / "sounds" / "tone.wav", 440)
    path = tmp_path / "set.json"
    path.write_text(json.dumps({"episodes": [episode("0", sound="tone")]}))
    with habitat.Env(config_of(path, f"+habitat.simulator.earshot.sound_root={tmp_path}/sounds").habitat) as env:
        heard = env.reset()["audiogoal"]
    strongest = np.abs(np.fft.rfft(heard[0])).argmax() * 16000 / heard.shape[1]
    assert strongest == pytest.approx(440, abs=2)
