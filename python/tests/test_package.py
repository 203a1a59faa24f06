# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import earshot


def loaded_after(code: str) -> str:
    """Files mapped by a fresh process after this code."""
    check = code + "\nprint(open('/proc/self/maps').read())"
    return subprocess.run([sys.executable, "-c", check], check=True, capture_output=True, text=True).stdout


def test_import_needs_numpy_alone() -> None:
    code = "import sys, earshot; assert not {'gymnasium', 'pettingzoo', 'torch'} & set(sys.modules)"
    maps = loaded_after(code)
    # An installed wheel does without the libraries that Debian builds under the GPL; a build for tests has those of the program.
    installed = "site-packages" in earshot.__file__
    for library in ("libtorch", "libzmq", *(("libavutil", "libswresample") if installed else ())):
        assert library not in maps


def test_package_is_typed_and_whole() -> None:
    folder = Path(earshot.__file__).parent
    assert (folder / "py.typed").is_file()
    assert (folder / "_engine.pyi").is_file()
    assert (folder / "earshot_reader").is_file()
    assert earshot.__version__


@pytest.mark.parametrize(("processor", "lacks"), [("Nehalem", "AVX, AVX2, BMI2, FMA"), ("SandyBridge", "AVX2, BMI2, FMA")])
def test_import_on_an_older_processor_says_what_is_missing(processor: str, lacks: str) -> None:
    qemu = shutil.which("qemu-x86_64-static") or shutil.which("qemu-x86_64")
    if platform.machine() != "x86_64" or qemu is None:
        pytest.skip("no qemu-user-static, or not an x86-64 machine")
    done = subprocess.run([qemu, "-cpu", processor, sys.executable, "-c", "import earshot"], capture_output=True, text=True)
    line = f"this build of Earshot uses instructions that this processor does not have ({lacks}); build it with -DEARSHOT_ARCH=x86-64"
    assert done.returncode == 1, done.stderr
    assert done.stderr.splitlines()[-1] == f"ImportError: {line}"


def test_ppo_example_runs(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    example = Path(__file__).parents[1] / "examples" / "ppo.py"
    done = subprocess.run(
        [sys.executable, str(example), "--num-envs", "4", "--num-steps", "16", "--total-steps", "128"],
        check=True,
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert "steps/s" in done.stdout
