from __future__ import annotations

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
