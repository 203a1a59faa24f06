# SPDX-License-Identifier: Apache-2.0
"""The build backend of the package: scikit-build-core, after a look for the headers that the build reads.

Where headers are missing, the hooks that build end with one line that names the Debian packages to install; CMake would say
the same at the end of a page of output.  Headers and packages are those of cmake/EarshotDependencies.cmake.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
Settings = dict[str, Any] | None


def listed_headers() -> tuple[list[tuple[list[str], str]], list[str]]:
    """Pairs of the names that a header goes by and its package, and the folders below those of the compiler in which headers lie."""
    text = re.sub(r"#.*", "", (ROOT / "cmake" / "EarshotDependencies.cmake").read_text())
    lists = {name: words.split() for name, words in re.findall(r"^set\((EARSHOT_HEADER\w+)([^()]*)\)", text, re.MULTILINE)}
    # The package is built with the permissive audio libraries (pyproject.toml).
    words = [*lists["EARSHOT_HEADERS_sim"], *lists["EARSHOT_HEADERS_audio_permissive"], *lists["EARSHOT_HEADERS_envs"]]
    return [(words[i].split("|"), words[i + 1]) for i in range(0, len(words), 2)], lists["EARSHOT_HEADER_FOLDERS"]


def compiler_folders() -> list[Path] | None:
    """Folders in which the C++ compiler looks for <...>; None without a compiler."""
    names = [os.environ["CXX"]] if os.environ.get("CXX") else ["c++", "g++", "clang++"]
    compiler = next((found for name in names if (found := shutil.which(name.split()[0]))), None)
    if compiler is None:
        return None
    command = [compiler, "-xc++", "-E", "-v", os.devnull]
    done = subprocess.run(command, env={**os.environ, "LC_ALL": "C"}, capture_output=True, text=True, check=False)
    block = re.search(r"^#include <.*?\n(.*?)^End", done.stderr, re.MULTILINE | re.DOTALL)
    return [Path(line.strip()) for line in block.group(1).splitlines()] if block else []


def looks_elsewhere(settings: Settings) -> bool:
    """Whether CMake is told to look for headers in other folders than the compiler's: then it alone can say what is missing."""
    words = "CMAKE_PREFIX_PATH|CMAKE_INCLUDE_PATH|CMAKE_TOOLCHAIN_FILE|CMAKE_SYSROOT|CMAKE_FIND_ROOT_PATH|CMAKE_CXX_COMPILER(?!_LAUNCHER)"
    given = [
        *(settings or {}).items(),
        *((name, value) for name, value in os.environ.items() if name.startswith(("CMAKE_", "SKBUILD_", "CONDA_PREFIX"))),
    ]
    return any(re.search(words + "|CONDA_PREFIX", f"{name}={value}") for name, value in given)


def missing_line() -> str:
    """One line that names what is missing and the command that installs it; empty if nothing is."""
    headers, below = listed_headers()
    folders = compiler_folders()
    missing, packages = [], []
    if folders is None:
        missing.append("a C++ compiler")
        packages.append("g++")
        folders = [Path("/usr/local/include"), Path("/usr/include"), *Path("/usr/include").glob("*-linux-gnu")]
    places = [folder / name for folder in folders for name in ("", *below)]
    for names, package in headers:
        if not any((place / name).is_file() for place in places for name in names):
            missing.append(names[0])
            packages.append(package)
    if not missing:
        return ""
    return f"earshot: missing {', '.join(missing)}: apt-get install {' '.join(dict.fromkeys(packages))} (or run scripts/setup.sh)"


def check_headers(settings: Settings) -> None:
    if not looks_elsewhere(settings) and (line := missing_line()):
        sys.exit(line)  # no traceback: pip shows this line alone


def backend() -> Any:
    import scikit_build_core.build

    return scikit_build_core.build


def get_requires_for_build_wheel(config_settings: Settings = None) -> Any:
    check_headers(config_settings)
    return backend().get_requires_for_build_wheel(config_settings)


def get_requires_for_build_editable(config_settings: Settings = None) -> Any:
    check_headers(config_settings)
    return backend().get_requires_for_build_editable(config_settings)


def get_requires_for_build_sdist(config_settings: Settings = None) -> Any:
    return backend().get_requires_for_build_sdist(config_settings)


def prepare_metadata_for_build_wheel(metadata_directory: str, config_settings: Settings = None) -> Any:
    check_headers(config_settings)
    return backend().prepare_metadata_for_build_wheel(metadata_directory, config_settings)


def prepare_metadata_for_build_editable(metadata_directory: str, config_settings: Settings = None) -> Any:
    check_headers(config_settings)
    return backend().prepare_metadata_for_build_editable(metadata_directory, config_settings)


def build_wheel(wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> Any:
    check_headers(config_settings)
    return backend().build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> Any:
    check_headers(config_settings)
    return backend().build_editable(wheel_directory, config_settings, metadata_directory)


def build_sdist(sdist_directory: str, config_settings: Settings = None) -> Any:
    return backend().build_sdist(sdist_directory, config_settings)
