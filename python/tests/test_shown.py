# SPDX-License-Identifier: Apache-2.0
"""What a notebook shows, plots, examples of docstrings, and memory."""

from __future__ import annotations

import base64
import doctest
import importlib
import re
import struct
import xml.etree.ElementTree as ElementTree
import zlib
from collections.abc import Callable
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from flat_memory import resets, scenes

import earshot
from earshot import _html
from earshot._wav import wav

Make = Callable[..., dict[str, Any]]
VOID = {"br", "img"}


@pytest.fixture(scope="module")
def response() -> earshot.Response:
    scene = earshot.Scene("shoebox:6x3x5@0.3", preset="fast", settings={"rir_length_s": 0.3})
    return scene.source([2, 1.5, 2]).response([4, 1.5, 3])


class Tags(HTMLParser):
    """Raises AssertionError for a tag that is not closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.seen.append(tag)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: object) -> None:
        self.seen.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_texts_are_one_line(response: earshot.Response, small: Make) -> None:
    envs, pair = earshot.make_vec(small(), num_envs=2), earshot.parallel_env(small(agents=2))
    assert repr(response.source.scene) == "earshot.Scene('shoebox:6x3x5@0.3', 12 triangles)"
    assert repr(response.source) == "earshot.Source([2, 1.5, 2], omni, in 'shoebox:6x3x5@0.3')"
    assert repr(response).startswith("earshot.Response(listener [4, 1.5, 3], earshot.Source(")
    assert re.fullmatch(r"earshot\.Arrivals\(\d+ paths: 1 direct, \d+ reflection.*\)", repr(response.arrivals))
    assert "T20" in repr(response.metrics)
    assert "2 envs" in repr(envs)
    assert "2 agents" in repr(pair)
    envs.close()
    for thing in (response, response.metrics, response.arrivals, envs, envs, pair, pair.batch):
        assert "\n" not in repr(thing)


def test_pages_are_whole_html(response: earshot.Response) -> None:
    page = Tags(response._repr_html_()).seen
    assert {"svg", "table", "img", "audio", "circle"} <= set(page)
    assert page.count("circle") == 2
    scene = response.source.scene
    assert "circle" not in Tags(scene._repr_html_()).seen
    assert Tags(response.source._repr_html_()).seen.count("circle") == 1
    assert Tags(response.metrics._repr_html_()).seen.count("tr") == 1 + len(_html.METRIC_ROWS)


def test_names_are_text_and_not_html() -> None:
    assert _html.table(["<b>"], [["a & b"]]) == "<table><tr><th>&lt;b&gt;</th></tr><tr><td>a &amp; b</td></tr></table>"


def test_the_plan_has_the_walls_of_the_box(response: earshot.Response) -> None:
    walls = response.source.scene.section(1.2)
    assert walls.shape == (8, 2, 3)  # two triangles each
    assert np.allclose(walls[..., 1], 1.2)
    length = np.linalg.norm(walls[:, 1] - walls[:, 0], axis=1).sum()
    assert length == pytest.approx(2 * (6 + 5), rel=1e-5)
    assert response.source.scene.section(50).shape == (0, 2, 3)
    svg = ElementTree.fromstring(_html.plan_svg(response.source.scene))
    assert float(svg.attrib["width"]) / float(svg.attrib["height"]) == pytest.approx((6 + 0.36) / (5 + 0.36), rel=0.01)


def test_pictures_and_sounds_are_files(response: earshot.Response) -> None:
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    picture = _html.png(pixels)
    assert picture[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", picture[16:24]) == (4, 3)
    length = struct.unpack(">I", picture[33:37])[0]
    lines = np.frombuffer(zlib.decompress(picture[41 : 41 + length]), np.uint8).reshape(3, 5)
    assert np.array_equal(lines[:, 1:], pixels)
    rir = response.render()
    sound = wav(_html.audible(rir), 16000)
    assert struct.unpack("<I", sound[4:8])[0] == len(sound) - 8
    assert np.frombuffer(sound[44:], "<i2").reshape(-1, 2).shape == rir.T.shape
    assert base64.b64decode(_html.inline("audio/wav", sound).partition(",")[2]) == sound


def test_a_spectrogram_has_a_tone_at_its_frequency() -> None:
    tone = np.sin(2 * np.pi * 2000 * np.arange(4000) / 16000)
    levels = _html.spectrogram_db(tone)
    assert int(levels[:, 20].argmax()) == round(2000 / 16000 * _html.SPECTROGRAM_SAMPLES)
    assert levels.max() == pytest.approx(0, abs=1e-9)


def test_plots_draw(response: earshot.Response, small: Make) -> None:
    pytest.importorskip("matplotlib").use("Agg")
    scene = response.source.scene
    ax = response.plot()
    assert ax.get_xlabel() == "time (ms)"
    ax = response.source.plot("drr_db", step_m=2)
    assert np.isfinite(ax.images[0].get_array()).any()
    envs = earshot.make_vec(small(), num_envs=1)
    envs.reset(seed=1)
    walked = [envs.batch.pose(0)[:3]]
    for action in (1, 1, 2, 1):
        envs.step(np.array([action]))
        walked.append(envs.batch.pose(0)[:3])
    house = earshot.Scene(envs.batch.scene_name(0), preset="fast")
    ax = house.plot(path=walked, points=walked[:1])
    assert np.allclose(ax.lines[1].get_xydata(), np.array(walked)[:, [0, 2]])
    for wrong in ({"quantity": "loudness"}, {"step_m": 0}, {"step_m": 1e-6}):
        with pytest.raises(earshot.InputError, match=r"Source\.plot"):
            response.source.plot(**wrong)
    assert scene.plot().get_title() == scene.name


@pytest.mark.parametrize("name", ["earshot", "earshot.acoustics", "earshot.responses", "earshot.config"])
def test_examples_of_docstrings_hold(name: str) -> None:
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert tried >= 4
    assert failed == 0


def test_memory_stays_flat() -> None:
    before, after = resets(300)
    assert after < 1.02 * before
    before, after = scenes(60)
    assert after < 1.02 * before
