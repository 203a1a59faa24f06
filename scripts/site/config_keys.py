#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""config_keys.py PROGRAM PAGE: writes the page of config keys that `PROGRAM config --markdown` prints."""

import pathlib
import subprocess
import sys

from output import write_if_new

MISSING = "# Config keys\n\nThe program that built these pages does not print its config keys (`earshot config --markdown`).\n"


def main(program: str, page: pathlib.Path) -> None:
    result = subprocess.run([program, "config", "--markdown"], capture_output=True, text=True, timeout=120, check=False)
    text = result.stdout
    if result.returncode == 2 and "is not a command" in result.stderr:
        print(f"docs: {program} has no command config; the page of config keys says so")
        text = MISSING
    elif result.returncode != 0:
        sys.exit(f"docs: {program} config --markdown ends with {result.returncode}: {result.stderr.strip()}")
    if not text.startswith("# "):
        text = "# Config keys\n\n" + text
    write_if_new(page, text)


if __name__ == "__main__":
    main(sys.argv[1], pathlib.Path(sys.argv[2]))
