#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""find_tests_test.py SOURCE_DIR BUILD_DIR: what scripts/find_tests.py selects for sources, test files, folders and names.

Every test file of this checkout that the build knows is drawn from by a fixed seed: the program and the tests that are selected for it are
compared with what the program itself lists.
"""

import os
import pathlib
import random
import subprocess
import sys

ROOT, BUILD = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
sys.dont_write_bytecode = True
sys.path.insert(0, str(ROOT / "scripts"))
import find_tests  # noqa: E402


def selected(*what: str) -> dict[str, set[str]]:
    result = subprocess.run([sys.executable, ROOT / "scripts/find_tests.py", BUILD, *what], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return {target: set(texts.split(":")) for target, texts in (line.split(" ", 1) for line in result.stdout.splitlines())}


def refused(what: str) -> str:
    result = subprocess.run([sys.executable, ROOT / "scripts/find_tests.py", BUILD, what], capture_output=True, text=True, check=False)
    assert result.returncode == 2 and result.stdout == "", (what, result)
    assert len(result.stderr.splitlines()) == 1 and what in result.stderr, result.stderr
    return result.stderr


def listed(program: pathlib.Path, texts: set[str]) -> list[str]:
    """What the program would run with this filter."""
    output = subprocess.run([program, "--gtest_list_tests", "--gtest_filter=" + ":".join(sorted(texts))], capture_output=True, text=True, check=True).stdout
    names, suite = [], ""
    for line in output.splitlines():
        if line.startswith("  "):
            names.append(suite + line.split("#")[0].strip())
        elif line.endswith(".") or ".  #" in line:
            suite = line.split("#")[0].strip()
    return names


# A source has the tests that are named after it, in the mirrored folder.
paths = selected("sim/acoustics/paths/utd.cpp")
assert set(paths) == {"test_sim_acoustics_paths"}, paths
assert any(text.startswith("Utd.") for text in paths["test_sim_acoustics_paths"]), paths
assert paths == selected("sim/acoustics/paths/utd.h") == selected(str(ROOT / "sim/acoustics/paths/utd.h")), "a header has the tests of its source"

# A name, with and without a test, and with a pattern.
whole = selected("AvNavTask")["test_envs"]
assert "AvNavTask.TurnsCostAStepAndLeadToTheSide" in whole and all(text.startswith("AvNavTask.") for text in whole), whole
assert selected("AvNavTask.TurnsCost*") == {"test_envs": {"AvNavTask.TurnsCostAStepAndLeadToTheSide"}}

# A folder has at least the tests of its files.
folder = selected("envs/task")["test_envs"]
assert whole <= folder, whole - folder
assert folder <= selected("tests/unit/envs")["test_envs"]

for what in ("no/such/file.cpp", "NoSuchSuite.*", "docs/index.md"):
    refused(what)

# Test files drawn at random: the program that they are said to be part of has all of their tests.
known = find_tests.programs(BUILD)
def is_comparable(file: str) -> bool:
    """A program that was linked after the file changed, and no test that the preprocessor may leave out."""
    source, program = ROOT / file, BUILD / "tests" / known[file]
    if not (file.endswith("_test.cpp") and source.is_file() and os.access(program, os.X_OK)):
        return False
    return program.stat().st_mtime > source.stat().st_mtime and "\n#if" not in "\n" + source.read_text(encoding="utf-8")


built = [file for file in sorted(known) if is_comparable(file)]
assert len(known) > 100, len(known)
drawn = random.Random(34).sample(built, min(12, len(built)))
for file in drawn:
    [(target, texts)] = selected(file).items()
    names = listed(BUILD / "tests" / target, texts)
    # A test with parameters or types is listed once for each.
    for text in texts:
        bare = text.strip("*/").split(".")[-1].strip("*/")
        assert any(bare in name for name in names), (file, text)
print(f"find_tests_test: {len(drawn)} of {len(built)} test files compared with their programs")
