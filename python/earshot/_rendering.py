# SPDX-License-Identifier: Apache-2.0
"""Pictures of an episode for people: the view of the agent, the floor around it, and the sound at both ears (of other
channels: the first two).

They come from sensors that a render mode adds to the batch.  These are no observations: they stand in no space, and the values of the
others do not depend on them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _arguments as check
from ._configs import is_on, key_value

MODES = ("rgb_array", "human")
SIDE = 256  #: of the view and the floor in pixels; each ear has a square of half this side
FRAME_SHAPE = (SIDE, 2 * SIDE + SIDE // 2, 3)

VIEW, FLOOR, SOUND = "earshot_view_rgb", "topdown_map", "spectrogram"
_HEARING = ("interaural", "waveform", "heard")
_GROUND = np.array([44, 48, 56], dtype=np.uint8)
_LAYERS = ((0, (222, 220, 212)), (1, (70, 130, 220)), (3, (40, 160, 70)), (2, (220, 50, 47)))  # channel of the map, colour
_SOUND_COLOURS = np.array([(12, 8, 38), (87, 16, 110), (187, 55, 84), (249, 142, 9), (252, 255, 164)], dtype=np.float32)
_LOUDEST = 3.0  #: value of the spectrogram, log(1 + magnitude), that gets the last colour


def check_mode(mode: str | None, function: str) -> str | None:
    return None if mode is None else check.one_of(mode, function, "render_mode", MODES)


def rendering_sensors(text: str, overrides: Sequence[str], mode: str | None) -> tuple[dict[str, str], set[str]]:
    """Keys of the env section that pictures need beside those of the config, and the sensors that are then no observations."""
    if mode is None:
        return {}, set()
    camera = f"{{width_px: {SIDE}, height_px: {SIDE}, rgb: true, depth: false}}"
    keys, hidden = {"observation.cameras.earshot_view": camera}, {VIEW}
    if not is_on(text, overrides, FLOOR):
        keys |= {"observation.topdown_map": "true", "observation.map.goal": "true"}
        keys |= {"observation.map.size_px": "128", "observation.map.metres_per_px": "0.0625"}
        hidden.add(FLOOR)
    hears = any(is_on(text, overrides, name) for name in _HEARING)
    if hears and not is_on(text, overrides, SOUND, default=True):
        keys["observation.spectrogram"] = "true"
        hidden.add(SOUND)
    return keys, hidden


def steps_per_second(config_text: str) -> int:
    """Frames per second that show an episode as fast as it runs."""
    return max(1, round(1 / float(key_value(config_text, (), "step_time_s") or 1)))


def draw(rows: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """A frame [256, 640, 3] of the sensors of one agent; black where there is none."""
    frame = np.zeros(FRAME_SHAPE, dtype=np.uint8)
    frame[:, :SIDE] = rows[VIEW]
    frame[:, SIDE : 2 * SIDE] = _scaled(_floor(rows[FLOOR]), SIDE)
    if SOUND in rows:
        half = SIDE // 2
        for ear in range(2):
            channel = min(ear, rows[SOUND].shape[-1] - 1)
            frame[ear * half : (ear + 1) * half, 2 * SIDE :] = _scaled(_sound(rows[SOUND][..., channel]), half)
    return frame


def tile(frames: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Frames of one size beside and below each other."""
    columns = max(1, round(math.sqrt(len(frames) * frames[0].shape[0] / frames[0].shape[1])))
    height, width = frames[0].shape[:2]
    board = np.zeros((math.ceil(len(frames) / columns) * height, columns * width, 3), dtype=np.uint8)
    for number, frame in enumerate(frames):
        top, left = number // columns * height, number % columns * width
        board[top : top + height, left : left + width] = frame
    return board


def _floor(layers: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """layers: [size, size, 3 or 4]: walkable floor, path, agent, goal."""
    picture = np.broadcast_to(_GROUND, (*layers.shape[:2], 3)).copy()
    for channel, colour in _LAYERS:
        if channel < layers.shape[2]:
            picture[layers[..., channel] > 0] = colour
    return picture


def _sound(spectrogram: NDArray[np.float32]) -> NDArray[np.uint8]:
    """spectrogram: [frequencies, times]; low frequencies below, the latest sound at the right."""
    place = np.clip(spectrogram[::-1] / _LOUDEST, 0, 1) * (len(_SOUND_COLOURS) - 1)
    lower = np.minimum(place.astype(np.int64), len(_SOUND_COLOURS) - 2)
    part = (place - lower)[..., None]
    colours: NDArray[np.float32] = (1 - part) * _SOUND_COLOURS[lower] + part * _SOUND_COLOURS[lower + 1]
    return colours.astype(np.uint8)


def _scaled(picture: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """The nearest pixels of [height, width, 3] in [side, side, 3]."""
    rows, columns = (np.arange(side) * size // side for size in picture.shape[:2])
    scaled: NDArray[np.uint8] = picture[rows[:, None], columns[None, :]]
    return scaled


class Window:
    """Shows frames in a window of pygame, at most `frames_per_s`."""

    def __init__(self, frames_per_s: int, title: str) -> None:
        try:
            import pygame
        except ImportError as error:
            raise ImportError("render_mode='human' needs pygame: pip install pygame") from error
        self._pygame: Any = pygame
        self._frames_per_s = frames_per_s
        self._title = title
        self._screen: Any = None
        self._clock: Any = pygame.time.Clock()

    def show(self, frame: NDArray[np.uint8]) -> None:
        size = frame.shape[1], frame.shape[0]
        if self._screen is None or self._screen.get_size() != size:
            self._pygame.display.init()
            self._screen = self._pygame.display.set_mode(size)
            self._pygame.display.set_caption(self._title)
        self._screen.blit(self._pygame.surfarray.make_surface(frame.swapaxes(0, 1)), (0, 0))
        self._pygame.event.pump()
        self._pygame.display.flip()
        self._clock.tick(self._frames_per_s)

    def close(self) -> None:
        if self._screen is not None:
            self._screen = None
            self._pygame.display.quit()
