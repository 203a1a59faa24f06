#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""find_tests.py BUILD WHAT...: the test programs and tests that concern WHAT, one line each: "TARGET FILTER" (scripts/dev.sh runs them).

WHAT is one of
  a test file      all of its tests
  a source         the tests of the mirrored folder under tests/unit whose file begins with its name; if there are none, those in files that
                   include its header; if there are none, all of that folder
  a folder         of sources or tests: all tests of it and below
  a name           of tests, as `Suite`, `Suite.Name` or with `*`: wherever they are
BUILD: a configured build folder, whose compile_commands.json says which program a test file is part of.
"""

import fnmatch
import json
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
TEST = re.compile(r"^(TEST|TEST_F|TEST_P|TYPED_TEST|TYPED_TEST_P)\(\s*(\w+),\s*(\w+)\s*\)", re.M)


def test_files() -> list[str]:
    found = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", "tests/*_test.cpp"], cwd=ROOT, check=True, capture_output=True, text=True)
    return [path for path in found.stdout.splitlines() if (ROOT / path).is_file()]


def tests_of(path: str) -> list[tuple[str, str, str]]:
    """(kind, suite, name) of each test of a file."""
    return TEST.findall((ROOT / path).read_text(encoding="utf-8"))


def filter_of(kind: str, suite: str, name: str) -> str:
    if kind == "TEST_P":
        return f"*{suite}.{name}/*"
    return f"*{suite}/*.{name}" if kind.startswith("TYPED") else f"{suite}.{name}"


def files_of_source(path: str) -> list[str]:
    """Test files for a source or header, from the nearest mirrored folder that has tests."""
    stem, folder = pathlib.PurePath(path).stem, pathlib.PurePath(path).parent
    everything = test_files()
    while str(folder) != ".":
        mirrored = [file for file in everything if file.startswith(f"tests/unit/{folder}/")]
        if mirrored:
            named = [file for file in mirrored if re.match(rf"{stem}_(\w+_)?test$", pathlib.PurePath(file).stem)]
            header = f'#include "{pathlib.PurePath(path).with_suffix(".h")}"'
            return named or [file for file in mirrored if header in (ROOT / file).read_text(encoding="utf-8")] or mirrored
        folder = folder.parent
    return []


def select(what: str) -> dict[str, list[tuple[str, str, str]]]:
    """Tests by file."""
    path = pathlib.Path(what)
    path = (path if path.is_absolute() else ROOT / path).resolve()
    if path.exists() and path.is_relative_to(ROOT):
        name = str(path.relative_to(ROOT))
        if path.is_dir():
            prefixes = (name + "/", f"tests/unit/{name}/")
            files = [file for file in test_files() if file.startswith(prefixes)]
        elif name.endswith("_test.cpp"):
            files = [name]
        else:
            files = files_of_source(name)
        return {file: tests_of(file) for file in files}
    pattern = what if "." in what else what + ".*"
    chosen = {file: [test for test in tests_of(file) if fnmatch.fnmatchcase(f"{test[1]}.{test[2]}", pattern)] for file in test_files()}
    return {file: tests for file, tests in chosen.items() if tests}


def programs(build: pathlib.Path) -> dict[str, str]:
    """The target that each test file is part of: alone, or in a source that joins several."""
    target_of = {}
    for entry in json.loads((build / "compile_commands.json").read_text(encoding="utf-8")):
        match = re.search(r"-o (?:\S*/)?CMakeFiles/(\w+)\.dir/", entry["command"])
        if not match:
            continue
        source = pathlib.Path(entry["file"])
        sources = [str(source)]
        if "/Unity/" in entry["file"] and source.is_file():
            sources = re.findall(r'^#include "(.+)"', source.read_text(encoding="utf-8"), flags=re.M)
        for file in sources:
            if "/tests/" in file:
                target_of["tests/" + file.split("/tests/", 1)[1]] = match[1]
    return target_of


def main(arguments: list[str]) -> int:
    if len(arguments) < 2:
        print(__doc__, file=sys.stderr)
        return 2
    target_of = programs(pathlib.Path(arguments[0]))
    filters: dict[str, list[str]] = {}
    for what in arguments[1:]:
        chosen = select(what)
        if not any(chosen.values()):
            print(f"dev: {what}: names no file of this checkout that has tests, and no test", file=sys.stderr)
            return 2
        for file, tests in chosen.items():
            target = target_of.get(file)
            if target is None:
                print(f"dev: {file}: is in no program of {arguments[0]} (slow tests are in the preset release alone)", file=sys.stderr)
                if len(chosen) == 1:
                    return 3
                continue
            known = filters.setdefault(target, [])
            known += [text for text in (filter_of(*test) for test in tests) if text not in known]
    for target, texts in filters.items():
        print(target, ":".join(texts))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
