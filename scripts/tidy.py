#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""scripts/tidy.py [--since COMMIT] [--seconds N]: clang-tidy 14 (.clang-tidy) on the lines that changed.

Looks at each source with a changed line, and at the source beside each header with one, and fails on a finding in a changed line.
--since COMMIT  what changed since then; without it uncommitted changes or, where there are none, the last commit
--seconds N     begins no file after N seconds, and says how many are left
Ends with 77 (skipped) and one line where clang-tidy 14 or clang++-14 is not installed.  EARSHOT_JOBS: how many at once (default: all cores).
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "tidy"


def git(*arguments: str) -> str:
    run = subprocess.run(["git", "-C", ROOT, *arguments], capture_output=True, text=True)
    if run.returncode:
        print(f"tidy: git {arguments[0]}: {run.stderr.strip()}", file=sys.stderr)
        sys.exit(2)
    return run.stdout


def changed_lines(since: str | None) -> dict[str, list[list[int]]]:
    """By path from the root: ranges of lines, first and last, of what was added or altered."""
    untracked = git("ls-files", "--others", "--exclude-standard", "--", "*.h", "*.cpp").splitlines()
    if since is None:
        since = "HEAD" if untracked or git("status", "--porcelain", "--untracked-files=no").strip() else "HEAD~1"
        if since == "HEAD~1" and not git("log", "-1", "--format=%P").strip():
            print("tidy: no commit before the last; --since names another")
            return {}
    counts = {name: len((ROOT / name).read_bytes().splitlines()) for name in untracked}
    lines = {name: [[1, count]] for name, count in counts.items() if count > 0}
    name = ""
    format_options = ["-U0", "--find-renames", "--no-ext-diff", "--no-color", "--src-prefix=a/", "--dst-prefix=b/"]
    for line in git("diff", *format_options, since, "--", "*.h", "*.cpp").splitlines():
        if line.startswith("+++ "):
            name = line[6:] if line.startswith("+++ b/") else ""
        elif name and (found := re.match(r"@@ -\S+ \+(\d+)(?:,(\d+))? @@", line)):
            first, count = int(found[1]), int(found[2] or 1)
            if count > 0:
                lines.setdefault(name, []).append([first, first + count - 1])
    return lines


def sources_of(lines: dict[str, list[list[int]]], compiled: set[str]) -> list[str]:
    beside = {re.sub(r"\.h$", ".cpp", name) for name in lines}
    return sorted(beside & compiled)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--since")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    options = parser.parse_args()
    for tool in ("clang-tidy-14", "clang++-14"):
        if shutil.which(tool) is None:
            print(f"tidy: skipped: {tool} is not installed (scripts/setup.sh)")
            return 77
    lines = changed_lines(options.since)
    if not lines:
        print("tidy: no line of a source or header has changed")
        return 0
    subprocess.run(["cmake", "--preset", "tidy"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    subprocess.run(["cmake", "--build", BUILD, "--target", "build_commit"], check=True, stdout=subprocess.DEVNULL)
    commands = json.loads((BUILD / "compile_commands.json").read_text())
    compiled = {os.path.relpath(command["file"], ROOT) for command in commands}
    sources = sources_of(lines, compiled)
    line_filter = json.dumps([{"name": name, "lines": ranges} for name, ranges in lines.items()])
    begin = time.monotonic()

    def look_at(source: str) -> tuple[str, str | None]:
        """Findings, or None where the time was up."""
        if time.monotonic() - begin >= options.seconds:
            return source, None
        command = ["clang-tidy-14", "-p", BUILD, "--quiet", "--warnings-as-errors=*", f"--line-filter={line_filter}", source]
        run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        return source, run.stdout + run.stderr if run.returncode else ""

    failed = left = 0
    with concurrent.futures.ThreadPoolExecutor(int(os.environ.get("EARSHOT_JOBS") or os.cpu_count() or 1)) as pool:
        for source, findings in pool.map(look_at, sources):
            if findings is None:
                left += 1
            elif findings:
                failed += 1
                print(f"tidy: {source}\n{findings}")
    rest = f"; {left} left, since {options.seconds:.0f} s were over" if left else ""
    print(f"tidy: {len(sources) - left} of {len(sources)} files with changed lines looked at, {failed} with findings{rest}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
