#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""tidy_test.py SCRIPT: does scripts/tidy.py find what is wrong in changed lines, and in these alone?  In a small project with a history."""

import pathlib
import shutil
import subprocess
import sys
import tempfile

SCRIPT = pathlib.Path(sys.argv[1]).resolve()
if shutil.which("clang-tidy-14") is None or shutil.which("clang++-14") is None:
    print("tidy_test: clang-tidy 14 is not installed")
    sys.exit(77)

PROJECT = """cmake_minimum_required(VERSION 3.20)
project(small CXX)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
add_library(small STATIC sim/a.cpp sim/b.cpp)
target_include_directories(small PRIVATE ${PROJECT_SOURCE_DIR})
add_custom_target(build_commit)
"""
PRESETS = """{"version": 3, "configurePresets": [{"name": "tidy", "generator": "Ninja", "binaryDir": "${sourceDir}/build/tidy",
 "cacheVariables": {"CMAKE_CXX_COMPILER": "clang++-14"}}]}"""
NULL_AS_ZERO = "int* {}() {{ return 0; }}\n"  # modernize-use-nullptr


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)

        def write(name: str, text: str) -> None:
            (root / name).parent.mkdir(exist_ok=True)
            (root / name).write_text(text)

        def git(*arguments: str) -> None:
            identity = ["-c", "user.name=a", "-c", "user.email=a@b.example", "-c", "init.defaultBranch=main"]
            subprocess.run(["git", *identity, *arguments], cwd=root, check=True, capture_output=True)

        def expect(status: int, text: str, *arguments: str) -> None:
            run = subprocess.run([sys.executable, root / "scripts/tidy.py", *arguments], capture_output=True, text=True)
            assert run.returncode == status and text in run.stdout + run.stderr, f"{arguments}: {run.returncode}\n{run.stdout}{run.stderr}"

        write("CMakeLists.txt", PROJECT)
        write("CMakePresets.json", PRESETS)
        write(".gitignore", "build/\n")
        write(".clang-tidy", "Checks: '-*,modernize-use-nullptr'\nHeaderFilterRegex: 'sim/.*'\n")
        write("sim/a.cpp", NULL_AS_ZERO.format("old"))
        write("sim/b.h", "#pragma once\n")
        write("sim/b.cpp", '#include "sim/b.h"\n')
        (root / "scripts").mkdir()
        shutil.copy(SCRIPT, root / "scripts/tidy.py")
        git("init", "-q")
        git("config", "diff.noprefix", "true")
        git("add", "-A")
        git("commit", "-q", "-m", "one")
        expect(0, "no commit before the last")
        write("sim/a.cpp", NULL_AS_ZERO.format("old") + "int more() { return 1; }\n")
        expect(0, "1 of 1 files with changed lines looked at, 0 with findings")
        write("sim/a.cpp", NULL_AS_ZERO.format("old") + NULL_AS_ZERO.format("fresh"))
        expect(1, "sim/a.cpp:2:")
        expect(0, "1 left, since 0 s were over", "--seconds", "0")
        git("commit", "-q", "-a", "-m", "two")
        expect(1, "sim/a.cpp:2:")
        # A header is looked at through the source beside it.
        write("sim/b.h", "#pragma once\ninline " + NULL_AS_ZERO.format("in_header"))
        expect(1, "sim/b.h:2:")
        expect(1, "2 of 2 files with changed lines looked at, 2 with findings", "--since", "HEAD~1")
        write("sim/b.h", "#pragma once\n\n")
        expect(0, "1 of 1 files")
        # One that git does not track yet.
        write("sim/c.cpp", NULL_AS_ZERO.format("untracked"))
        write("sim/empty.h", "")
        write("CMakeLists.txt", PROJECT.replace("sim/b.cpp", "sim/b.cpp sim/c.cpp"))
        expect(1, "sim/c.cpp:1:")
        expect(2, "tidy: git diff:", "--since", "no_such_commit")


main()
