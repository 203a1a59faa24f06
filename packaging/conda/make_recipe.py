#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""make_recipe.py --sdist FILE --url URL --out FOLDER: writes FOLDER/recipe.yaml for conda-forge.

FILE is the source distribution (``python -m build --sdist``), URL the address from which conda-forge takes it.  The version is that of CMakeLists.txt.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TEMPLATE = Path(__file__).with_name("recipe.yaml.in")


def version() -> str:
    found = re.search(r"project\(earshot VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8"))
    if not found:
        sys.exit("make_recipe: CMakeLists.txt has no version")
    return found.group(1)


def recipe(url: str, sha256: str) -> str:
    text = TEMPLATE.read_text(encoding="utf-8")
    for name, value in (("@VERSION@", version()), ("@URL@", url), ("@SHA256@", sha256)):
        text = text.replace(name, value)
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the recipe for conda-forge.")
    parser.add_argument("--sdist", type=Path, required=True)
    parser.add_argument("--url", required=True)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    if not options.sdist.is_file():
        sys.exit(f"make_recipe: --sdist {options.sdist}: no such file; make it with python -m build --sdist")
    if version() not in options.sdist.name:
        sys.exit(f"make_recipe: --sdist {options.sdist}: is not of version {version()}")
    options.out.mkdir(parents=True, exist_ok=True)
    text = recipe(options.url, hashlib.sha256(options.sdist.read_bytes()).hexdigest())
    (options.out / "recipe.yaml").write_text(text, encoding="utf-8")
    print(options.out / "recipe.yaml")


if __name__ == "__main__":
    main()
