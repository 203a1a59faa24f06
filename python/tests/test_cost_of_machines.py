# SPDX-License-Identifier: Apache-2.0
"""The cost model of docs/howto/many_machines.md: closed forms, and that the page shows what the script calculates."""

from __future__ import annotations

import importlib.util
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def model() -> Any:
    spec = importlib.util.spec_from_file_location("cost_of_machines", ROOT / "scripts/cost_of_machines.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def inputs(model: Any, **changes: float) -> Any:
    return SimpleNamespace(**{**{name: default for name, default, _, _ in model.INPUTS}, **changes})


def test_the_page_shows_the_tables_of_the_script(model: Any) -> None:
    page = (ROOT / "docs/howto/many_machines.md").read_text()
    for block in model.tables(inputs(model)).split("\n\n"):
        assert block in page


def test_every_input_is_named_on_the_page(model: Any) -> None:
    page = re.sub(r"\s+", " ", (ROOT / "docs/howto/many_machines.md").read_text())
    defaults = {name: default for name, default, _, _ in model.INPUTS}
    for text in (
        f"{1000 * defaults['response_s']:g} ms of processor time, {1000 * defaults['response_mb']:g} kB",
        f"{defaults['part_start_s']:g} s",
        f"{defaults['task_s']:g} s of processor time; {defaults['copy_s_per_mb']:g} s per MB",
        f"{1000 * defaults['step_s']:g} ms",
        f"{defaults['rollout_s']:g} +- {defaults['rollout_s'] * defaults['rollout_spread']:g} s, {defaults['learn_s']:g} s",
        f"{defaults['sums']:g} of {defaults['sum_mb']:g} MB, {defaults['link_gbit_per_s']:g} Gbit/s and {1000 * defaults['link_s']:g} ms",
        f"{defaults['caller_mb_per_s'] / 1000:g} GB/s, {defaults['shared_mb_per_s'] / 1000:g} GB/s, {defaults['queue_s']:g} s",
    ):
        assert text in page


def test_the_largest_of_normal_draws(model: Any) -> None:
    """David and Nagaraja 2003: 1 / sqrt(pi) of two, 3 / (2 sqrt(pi)) of three; 1.4236 of eight.  The sum has an error below 1e-4."""
    assert model.largest_of(1) == pytest.approx(0, abs=1e-4)
    assert model.largest_of(2) == pytest.approx(1 / math.sqrt(math.pi), abs=1e-4)
    assert model.largest_of(3) == pytest.approx(1.5 / math.sqrt(math.pi), abs=1e-4)
    assert model.largest_of(8) == pytest.approx(1.4236, abs=1e-4)


def test_times_follow_from_their_inputs(model: Any) -> None:
    """Ten drawn sets of inputs, each against the sum worked by hand for one and for very many cores."""
    rng = np.random.default_rng(8)
    for _ in range(10):
        parts, per_part = int(rng.integers(2, 400)), int(rng.integers(10, 2000))
        keys = {
            "response_s": rng.uniform(0.001, 0.1),
            "part_start_s": rng.uniform(0, 1),
            "task_s": rng.uniform(0, 1),
            "queue_s": rng.uniform(0, 9),
        }
        i = inputs(model, responses=parts * per_part, responses_per_part=per_part, response_mb=1e-9, **keys)
        part = keys["response_s"] * per_part
        assert model.corpus_s(1, i, "one") == pytest.approx(parts * part)
        assert model.corpus_s(1, i, "array") == pytest.approx(keys["queue_s"] + keys["part_start_s"] + parts * part)
        assert model.corpus_s(1, i, "ray") == pytest.approx(keys["queue_s"] + parts * (part + keys["part_start_s"] + keys["task_s"]))
        assert model.corpus_s(10**6, i, "ray_shared") == pytest.approx(keys["queue_s"] + part + keys["part_start_s"] + keys["task_s"])
        slow = inputs(model, responses=parts * per_part, responses_per_part=per_part, caller_mb_per_s=1e-3)
        assert model.corpus_s(10**6, slow, "ray") == pytest.approx(slow.queue_s + parts * per_part * slow.response_mb * 1e3)
        for way in ("array", "ray", "ray_shared"):
            times = [model.corpus_s(cores, i, way) for cores in (1, 2, 7, 100, 10**5)]
            assert times == sorted(times, reverse=True)
        assert model.sweep_s(7, i) == pytest.approx(keys["queue_s"] + 5 * i.run_core_s)  # 30 runs on 7 cores: five rounds
        hosts = int(rng.integers(2, 50))
        byte_s = 8 / (i.link_gbit_per_s * 1e9)
        ring = 2 * (hosts - 1) * (i.link_s + i.sum_mb * 1e6 / hosts * byte_s)
        assert model.sum_s(hosts * 64, i) == pytest.approx(ring)
        update, fraction = model.training_parts(1, i)
        assert (update, fraction) == (pytest.approx(18.8), pytest.approx(1))
        assert model.training_parts(2, i)[0] == pytest.approx(18.8 + 3 / math.sqrt(math.pi), abs=1e-3)
