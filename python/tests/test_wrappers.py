# SPDX-License-Identifier: Apache-2.0
"""Every wrapper of gymnasium 1.x around a single env and around a batch in each autoreset mode: it works, or it is refused with a reason.

A wrapper that gymnasium adds makes test_no_wrapper_is_left_out fail until it has a row here.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces, wrappers
from gymnasium.wrappers import vector

import earshot

Make = Callable[..., dict[str, Any]]
Wrap = Callable[[Any], Any]
MODES = ["same_step", "next_step", "disabled"]
PICTURE = spaces.Box(0, 255, (16, 16, 3), np.uint8)


def picture(env: Any) -> Any:
    """The picture alone, as an env of pixels."""
    return wrappers.TransformObservation(env, lambda obs: obs["rgb"], PICTURE)


def pictures(envs: Any) -> Any:
    return vector.TransformObservation(envs, lambda obs: obs["rgb"], single_observation_space=PICTURE)


def numbers(env: Any) -> Any:
    return wrappers.FlattenObservation(wrappers.FilterObservation(env, ["pointgoal", "collision"]))


def flat_numbers(envs: Any) -> Any:
    return vector.FlattenObservation(vector.FilterObservation(envs, ["pointgoal", "collision"]))


def steered(env: Any) -> Any:
    """Actions as a number in [-1, 3], for the wrappers that take numbers alone."""
    return wrappers.TransformAction(env, lambda action: int(np.clip(np.rint(action[0]), 0, 3)), spaces.Box(-1, 3, (1,), np.float32))


def all_steered(envs: Any) -> Any:
    box = spaces.Box(-1, 3, (1,), np.float32)
    return vector.TransformAction(envs, lambda actions: np.clip(np.rint(actions[:, 0]), 0, 3).astype(np.int64), single_action_space=box)


# Name: how to wrap, and what is missing where the packages that follow are.
SINGLE: dict[str, tuple[Wrap, tuple[str, ...]]] = {
    "AddRenderObservation": (lambda env: wrappers.AddRenderObservation(env), ()),
    "AddWhiteNoise": (lambda env: wrappers.AddWhiteNoise(picture(env), 0.5), ()),
    "ArrayConversion": (lambda env: wrappers.ArrayConversion(env, env_xp=np, target_xp=np), ("array_api_compat",)),
    "Autoreset": (wrappers.Autoreset, ()),
    "ClipAction": (lambda env: wrappers.ClipAction(steered(env)), ()),
    "ClipReward": (lambda env: wrappers.ClipReward(env, -1, 1), ()),
    "DelayObservation": (lambda env: wrappers.DelayObservation(picture(env), 2), ()),
    "DiscretizeAction": (lambda env: wrappers.DiscretizeAction(steered(env), 5), ()),
    "DiscretizeObservation": (
        lambda env: wrappers.DiscretizeObservation(wrappers.RescaleObservation(picture(env), np.float32(0), np.float32(1)), bins=3),
        (),
    ),
    "DtypeObservation": (lambda env: wrappers.DtypeObservation(picture(env), np.float32), ()),
    "FilterObservation": (lambda env: wrappers.FilterObservation(env, ["depth"]), ()),
    "FlattenObservation": (wrappers.FlattenObservation, ()),
    "FrameStackObservation": (lambda env: wrappers.FrameStackObservation(env, 3), ()),
    "GrayscaleObservation": (lambda env: wrappers.GrayscaleObservation(picture(env)), ("cv2",)),
    "HumanRendering": (wrappers.HumanRendering, ("pygame", "cv2")),
    "JaxToNumpy": (lambda env: wrappers.JaxToNumpy(env), ("jax", "array_api_compat")),
    "JaxToTorch": (lambda env: wrappers.JaxToTorch(env), ("jax", "torch", "array_api_compat")),
    "MaxAndSkipObservation": (lambda env: wrappers.MaxAndSkipObservation(picture(env), 2), ()),
    "NormalizeObservation": (lambda env: wrappers.NormalizeObservation(numbers(env)), ()),
    "NormalizeReward": (wrappers.NormalizeReward, ()),
    "NumpyToTorch": (lambda env: wrappers.NumpyToTorch(env), ("torch", "array_api_compat")),
    "OrderEnforcing": (wrappers.OrderEnforcing, ()),
    "ObstructView": (lambda env: wrappers.ObstructView(picture(env), 0.2, 4), ()),
    "PassiveEnvChecker": (wrappers.PassiveEnvChecker, ()),
    "RecordEpisodeStatistics": (wrappers.RecordEpisodeStatistics, ()),
    "RecordVideo": (lambda env: wrappers.RecordVideo(env, "videos", disable_logger=True), ("moviepy",)),
    "RenderCollection": (wrappers.RenderCollection, ()),
    "RepeatAction": (lambda env: wrappers.RepeatAction(env, 2), ()),
    "RescaleAction": (lambda env: wrappers.RescaleAction(steered(env), np.float32(0), np.float32(1)), ()),
    "RescaleObservation": (lambda env: wrappers.RescaleObservation(picture(env), np.float32(0), np.float32(1)), ()),
    "ReshapeObservation": (lambda env: wrappers.ReshapeObservation(picture(env), (768,)), ()),
    "ResizeObservation": (lambda env: wrappers.ResizeObservation(picture(env), (8, 8)), ("cv2",)),
    "StickyAction": (lambda env: wrappers.StickyAction(env, 0.3), ()),
    "TimeAwareObservation": (lambda env: wrappers.TimeAwareObservation(wrappers.TimeLimit(env, 10)), ()),
    "TimeLimit": (lambda env: wrappers.TimeLimit(env, 5), ()),
    "TransformAction": (steered, ()),
    "TransformObservation": (picture, ()),
    "TransformReward": (lambda env: wrappers.TransformReward(env, lambda reward: 2 * float(reward)), ()),
}
# Refused: the error, and why.
SINGLE_REFUSED: dict[str, tuple[Wrap, type[Exception], str]] = {
    "AtariPreprocessing": (wrappers.AtariPreprocessing, ValueError, "frame-skipping"),  # for the Atari games alone
    "ClipAction": (wrappers.ClipAction, TypeError, "requires a Box action space"),  # ours is Discrete
    "RescaleAction": (lambda env: wrappers.RescaleAction(env, np.float32(-1), np.float32(1)), TypeError, "requires a Box action space"),
    "DiscretizeAction": (lambda env: wrappers.DiscretizeAction(env, 5), TypeError, "Box"),
}
VECTOR: dict[str, tuple[Wrap, tuple[str, ...]]] = {
    "ArrayConversion": (lambda envs: vector.ArrayConversion(envs, env_xp=np, target_xp=np), ("array_api_compat",)),
    "ClipAction": (lambda envs: vector.ClipAction(all_steered(envs)), ()),
    "ClipReward": (lambda envs: vector.ClipReward(envs, -1, 1), ()),
    "DictInfoToList": (vector.DictInfoToList, ()),
    "DtypeObservation": (lambda envs: vector.DtypeObservation(pictures(envs), np.float32), ()),
    "FilterObservation": (lambda envs: vector.FilterObservation(envs, ["depth"]), ()),
    "FlattenObservation": (vector.FlattenObservation, ()),
    "GrayscaleObservation": (lambda envs: vector.GrayscaleObservation(pictures(envs)), ("cv2",)),
    "HumanRendering": (vector.HumanRendering, ("pygame", "cv2")),
    "JaxToNumpy": (lambda env: vector.JaxToNumpy(env), ("jax", "array_api_compat")),
    "JaxToTorch": (lambda env: vector.JaxToTorch(env), ("jax", "torch", "array_api_compat")),
    "NormalizeObservation": (lambda envs: vector.NormalizeObservation(flat_numbers(envs)), ()),
    "NormalizeReward": (vector.NormalizeReward, ()),
    "NumpyToTorch": (lambda env: vector.NumpyToTorch(env), ("torch", "array_api_compat")),
    "RecordEpisodeStatistics": (vector.RecordEpisodeStatistics, ()),
    "RecordVideo": (lambda envs: vector.RecordVideo(envs, "videos", disable_logger=True), ("moviepy",)),
    "RescaleAction": (lambda envs: vector.RescaleAction(all_steered(envs), 0, 1), ()),
    "RescaleObservation": (lambda envs: vector.RescaleObservation(pictures(envs), np.float32(0), np.float32(1)), ()),
    "ReshapeObservation": (lambda envs: vector.ReshapeObservation(pictures(envs), (768,)), ()),
    "ResizeObservation": (lambda envs: vector.ResizeObservation(pictures(envs), (8, 8)), ("cv2",)),
    "TransformAction": (all_steered, ()),
    "TransformObservation": (pictures, ()),
    "TransformReward": (lambda envs: vector.TransformReward(envs, lambda rewards: 2 * rewards), ()),
    "VectorizeTransformAction": (
        lambda envs: vector.VectorizeTransformAction(
            envs, wrappers.TransformAction, func=lambda action: int(action), action_space=spaces.Discrete(4)
        ),
        (),
    ),
    "VectorizeTransformObservation": (
        lambda envs: vector.VectorizeTransformObservation(
            envs, wrappers.TransformObservation, func=lambda obs: obs["rgb"], observation_space=PICTURE
        ),
        (),
    ),
    "VectorizeTransformReward": (
        lambda envs: vector.VectorizeTransformReward(envs, wrappers.TransformReward, func=lambda reward: 2 * reward),
        (),
    ),
}


RENDER = {"AddRenderObservation", "HumanRendering", "RecordVideo", "RenderCollection"}  # these need a render mode
# These convert every array of the infos, but final_obs is an array of objects, as in gymnasium's own batches.
NO_FINAL_OBSERVATIONS = {"ArrayConversion", "NumpyToTorch"}
# Gymnasium's own rule: these take over what reset and step return, which leaves out the final observations of "same_step".
NOT_SAME_STEP = {
    "DtypeObservation",
    "FilterObservation",
    "FlattenObservation",
    "GrayscaleObservation",
    "NormalizeObservation",
    "RescaleObservation",
    "ReshapeObservation",
    "ResizeObservation",
    "TransformObservation",
    "VectorizeTransformObservation",
}
NOT_DISABLED = {"NormalizeObservation"}  # takes "next_step" alone


def skip_without(packages: tuple[str, ...]) -> None:
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)} not installed")


def env_for(name: str, made: dict[str, Any], small: Make, mode: str | None) -> Any:
    """mode: of autoreset; None: a single env."""
    if name not in RENDER:
        if str(mode) not in made:
            made[str(mode)] = earshot.make_vec(small(), 3, autoreset_mode=mode) if mode else earshot.make(small())
        return made[str(mode)]
    keys: dict[str, Any] = {"render_mode": "rgb_array"}
    env: Any = earshot.make_vec(small(), 3, autoreset_mode=mode, **keys) if mode else earshot.make(small(), **keys)
    env.metadata["render_fps"] = 1000  # windows do not wait
    return env


def close(name: str, wrapped: Any) -> None:
    if name in RENDER:
        wrapped.close()


def as_numpy(obs: Any) -> Any:
    """Tensors as arrays, whose space holds arrays."""
    if isinstance(obs, dict):
        return {name: as_numpy(one) for name, one in obs.items()}
    return np.asarray(obs) if "torch" in str(type(obs)) else obs


def walk(env: Any, rng: np.random.Generator, num_envs: int | None) -> int:
    """Steps over several ends of episodes; observations are those of the space."""
    disabled = num_envs is None or env.metadata["autoreset_mode"] == gymnasium.vector.AutoresetMode.DISABLED
    obs, _ = env.reset(seed=3)
    assert env.observation_space.contains(as_numpy(obs))
    env.action_space.seed(int(rng.integers(1000)))
    ends = 0
    for _ in range(30):
        obs, rewards, terminated, truncated, _ = env.step(env.action_space.sample())
        assert env.observation_space.contains(as_numpy(obs))
        assert np.shape(rewards) == np.shape(terminated) == np.shape(truncated) == (() if num_envs is None else (num_envs,))
        assert np.isfinite(np.asarray(rewards)).all()
        ended = np.asarray(terminated) | np.asarray(truncated)
        ends += int(ended.sum())
        if disabled and ended.any():
            env.reset() if num_envs is None or ended.all() else env.reset(options={"reset_mask": ended})
    return ends


@pytest.fixture(scope="module")
def made() -> dict[str, Any]:
    """Envs that several tests wrap, each from a reset on."""
    return {}


@pytest.fixture
def quiet(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.chdir(tmp_path)


def test_no_wrapper_is_left_out() -> None:
    assert set(wrappers.__all__) - {"vector"} == set(SINGLE) | set(SINGLE_REFUSED)
    assert set(vector.__all__) == set(VECTOR)


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("name", SINGLE)
@pytest.mark.filterwarnings("ignore")
def test_single_wrappers(small: Make, made: dict[str, Any], name: str) -> None:
    wrap, packages = SINGLE[name]
    skip_without(packages)
    env = wrap(env_for(name, made, small, None))
    assert walk(env, np.random.default_rng(1), None) >= 2
    close(name, env)


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("name", SINGLE_REFUSED)
def test_single_wrappers_that_are_refused(small: Make, name: str) -> None:
    wrap, error, reason = SINGLE_REFUSED[name]
    with pytest.raises(error, match=reason):
        wrap(earshot.make(small()))


def refusal(name: str, mode: str) -> str | None:
    """What gymnasium says where a wrapper does not take the mode."""
    if (mode == "same_step" and name in NOT_SAME_STEP) or (mode == "disabled" and name in NOT_DISABLED):
        return "Expected .*autoreset_mode"
    return None


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", VECTOR)
@pytest.mark.filterwarnings("ignore")
def test_vector_wrappers(small: Make, made: dict[str, Any], name: str, mode: str) -> None:
    wrap, packages = VECTOR[name]
    skip_without(packages)
    envs = env_for(name, made, small, mode)
    expected = refusal(name, mode)
    if expected:
        with pytest.raises(ValueError, match=expected):
            wrap(envs)
        return
    wrapped = wrap(envs)
    if mode == "same_step" and name in NO_FINAL_OBSERVATIONS:
        with pytest.raises((BufferError, TypeError)):
            walk(wrapped, np.random.default_rng(1), 3)
        return
    assert walk(wrapped, np.random.default_rng(1), 3) >= 4
    close(name, wrapped)


def test_wrapped_observations_are_those_of_the_envs(small: Make) -> None:
    plain = earshot.make_vec(small(), 3, copy=True)
    halved = vector.TransformObservation(
        earshot.make_vec(small(), 3),
        lambda obs: obs["rgb"].astype(np.float32) / 2,
        single_observation_space=spaces.Box(0, 128, (16, 16, 3), np.float32),
    )
    plain.reset(seed=2)
    halved.reset(seed=2)
    rng = np.random.default_rng(4)
    for _ in range(20):  # over ends of episodes
        actions = rng.choice(4, size=3, p=[0.1, 0.5, 0.2, 0.2])
        obs, *_ = plain.step(actions)
        halves, *_ = halved.step(actions)
        assert np.array_equal(halves, obs["rgb"].astype(np.float32) / 2)
