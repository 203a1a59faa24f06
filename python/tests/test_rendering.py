# SPDX-License-Identifier: Apache-2.0
"""Render modes, and attributes of the envs of a batch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import earshot
from earshot import _rendering

Make = Callable[..., dict[str, Any]]


def walk(env: Any) -> list[Any]:
    trace = [env.reset(seed=2)[0]]
    for action in (1, 2, 1, 3, 1):
        trace.append(env.step(action)[:4])
    return trace


def test_a_render_mode_changes_no_observation(small: Make) -> None:
    plain, drawn = earshot.make(small()), earshot.make(small(), render_mode="rgb_array")
    assert plain.observation_space == drawn.observation_space
    assert data_equivalence(walk(plain), walk(drawn), exact=True)


def test_frames_show_view_floor_and_sound(small: Make) -> None:
    config = small()
    config["observation"]["camera"] = {"width_px": 256, "height_px": 256}
    config["observation"] |= {"topdown_map": True}
    env = earshot.make(config, render_mode="rgb_array")
    obs, _ = env.reset(seed=1)
    for action in (1, 2, 2):
        obs, *_ = env.step(action)
    frame = env.render()
    assert frame.shape == _rendering.FRAME_SHAPE
    assert frame.dtype == np.uint8
    # The camera of the frame stands where that of the agent does by default.
    assert np.array_equal(frame[:, :256], obs["rgb"])
    agent = (frame[:, 256:512] == (220, 50, 47)).all(axis=2)
    rows, columns = np.nonzero(agent)
    assert abs(rows.mean() - 128) < 12  # the map of the agent has it in the middle
    assert abs(columns.mean() - 128) < 12
    # The brightest of the strip of an ear is where its spectrogram is loudest.
    loud = obs["spectrogram"].max(axis=(0, 1))
    strips = frame[:128, 512:].astype(int).sum(), frame[128:, 512:].astype(int).sum()
    assert min(strips) > 0
    assert (strips[0] > strips[1]) == (loud[0] > loud[1]) or np.isclose(*strips, rtol=0.2)


def test_a_silent_config_draws_no_sound(small: Make) -> None:
    config = small()
    config["observation"]["spectrogram"] = False
    env = earshot.make(config, render_mode="rgb_array")
    env.reset(seed=1)
    assert not env.render()[:, 512:].any()


@pytest.mark.parametrize("count", [1, 3, 5])
def test_a_batch_draws_a_frame_per_env(small: Make, count: int) -> None:
    envs = earshot.make_vec(small(), count, render_mode="rgb_array")
    single = earshot.make(small(), render_mode="rgb_array")
    envs.reset(seed=5)
    frames = envs.render()
    assert frames is not None
    assert len(frames) == count
    single.reset(seed=5)
    assert np.array_equal(frames[0], single.render())
    assert all(np.array_equal(a, b) for a, b in zip(envs.call("render"), frames, strict=True))
    board = _rendering.tile(frames)
    assert board.shape[0] * board.shape[1] >= count * frames[0].shape[0] * frames[0].shape[1]
    assert np.array_equal(board[: frames[0].shape[0], : frames[0].shape[1]], frames[0])


@pytest.mark.parametrize("many", [False, True])
def test_human_mode_shows_each_step(small: Make, many: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame", reason="no pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    shown: list[Any] = []
    monkeypatch.setattr(pygame.display, "flip", lambda: shown.append(pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)))
    monkeypatch.setattr(_rendering, "steps_per_second", lambda text: 1000)
    env: Any = earshot.make_vec(small(), 2, render_mode="human") if many else earshot.make(small(), render_mode="human")
    same: Any = earshot.make_vec(small(), 2, render_mode="rgb_array") if many else earshot.make(small(), render_mode="rgb_array")
    env.reset(seed=1)
    same.reset(seed=1)
    for _ in range(2):
        env.step(np.array([1, 2]) if many else 1)
        same.step(np.array([1, 2]) if many else 1)
    assert env.render() is None
    assert len(shown) == 3
    expected = _rendering.tile(same.render()) if many else same.render()
    assert np.array_equal(shown[-1], expected)
    env.close()
    assert not pygame.display.get_init()


def test_wrong_render_calls_say_what_to_do(small: Make) -> None:
    with pytest.raises(ValueError, match="render_mode is 'ansi'; give one of rgb_array, human"):
        earshot.make(small(), render_mode="ansi")
    envs = earshot.make_vec(small(), 1, render_mode="rgb_array")
    with pytest.raises(RuntimeError, match="needs a reset"):
        envs.render()
    with pytest.raises(RuntimeError, match="needs a render_mode"):
        earshot.make_vec(small(), 1).call("render")
    with pytest.warns(UserWarning, match="needs a render_mode"):
        assert earshot.make(small()).render() is None
    envs.reset(seed=1)
    envs.close()
    with pytest.raises(RuntimeError, match="closed"):
        envs.render()


def test_lists_of_frames_come_from_gymnasium(small: Make) -> None:
    env = gymnasium.make("earshot/AudioGoal-v0", config=small(), rules=(), render_mode="rgb_array_list")
    env.reset(seed=1)
    env.step(1)
    assert [frame.shape for frame in env.render()] == [_rendering.FRAME_SHAPE] * 2  # type: ignore[union-attr]


def test_attributes_of_the_envs_of_a_batch(small: Make) -> None:
    envs = earshot.make_vec(small(), 3, copy=True)
    envs.reset(seed=1)
    assert envs.get_attr("pose") == tuple(envs.batch.pose(row) for row in range(3))
    assert envs.call("scene_name") == ("house:1,rooms=3,area_m2=36",) * 3
    states = envs.call("snapshot")
    first, *_ = envs.step(np.array([1, 2, 3]))
    for env, state in zip(envs.envs, states, strict=True):
        env.restore(state)
    again, *_ = envs.step(np.array([1, 2, 3]))
    assert all(np.array_equal(first[key], again[key]) for key in first)
    envs.set_attr("level", 2)
    envs.set_attr("mark", ["a", "b", "c"])
    assert envs.get_attr("level") == (2, 2, 2)
    assert envs.call("mark") == ("a", "b", "c")
    with pytest.raises(ValueError, match="2 values for 3 envs"):
        envs.set_attr("mark", ["a", "b"])
    with pytest.raises(AttributeError, match="'pose' of an env of the batch cannot be set"):
        envs.set_attr("pose", 1)
    with pytest.raises(AttributeError, match=r"no attribute 'weather'; it has .*pose"):
        envs.get_attr("weather")
