# SPDX-License-Identifier: Apache-2.0
"""The programs "after" of docs/howto/coming_over.md run as they stand on the page, and print what it says."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs/howto/coming_over.md"
#: Programs for Earshot; those of the other simulators are marked "py".
PROGRAMS = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), flags=re.S | re.M)


def test_the_page_has_a_program_of_each_kind() -> None:
    calls = ["source.render(", "earshot.make(", "random_positions("]
    assert [sum(call in program for program in PROGRAMS) for call in calls] == [1, 1, 1]


@pytest.mark.parametrize("program", PROGRAMS)
def test_programs_run(program: str, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    told = re.findall(r"^print\(.*\)\s*# (.*)$", program, flags=re.M)
    printed = done.stdout.splitlines()
    assert len(printed) == 1
    if told:
        assert printed == told
    else:
        assert 0 <= float(printed[0]) <= 1
