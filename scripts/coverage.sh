#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/coverage.sh [CTEST ARGUMENTS...]
# Builds the preset `coverage` (g++), runs its tests (all but the slow and long ones, or those that the arguments choose) and
# prints, by folder, how many lines of code they run.  build/coverage/lines.txt has a row per source.
# Exit status: that of the tests.  EARSHOT_JOBS: how many jobs at once (default: all cores).
set -euo pipefail
cd "$(dirname "$0")/.."

gcov=gcov-$(g++ -dumpversion)
command -v "$gcov" >/dev/null || { echo "coverage: $gcov is missing: scripts/setup.sh installs g++, which has it" >&2; exit 2; }
build=build/coverage
jobs=${EARSHOT_JOBS:-$(nproc)}
scripts/build.sh coverage
find "$build" -name '*.gcda' -delete
status=0
ctest --preset coverage -j "$jobs" "$@" || status=$?
python3 - "$build" "$gcov" "$jobs" <<'PYTHON'
import collections, concurrent.futures, json, os, pathlib, subprocess, sys
build, gcov, jobs = pathlib.Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
root = os.getcwd() + "/"
rooms = ("sim", "envs", "datasets", "api", "policy", "trainer", "evaluation", "bench", "apps")

def counts_of(notes):
    """How often each line of our sources ran in one object; an object that no test has run has zeros."""
    gcov_run = subprocess.run([gcov, "--json-format", "--stdout", str(notes)], capture_output=True, text=True)
    if gcov_run.returncode:
        raise RuntimeError(f"{gcov} {notes}: {gcov_run.stderr.strip()}")
    found = []
    for text in gcov_run.stdout.splitlines():
        report = json.loads(text)
        for file in report["files"]:
            name = os.path.normpath(os.path.join(report["current_working_directory"], file["file"])).removeprefix(root)
            if name.split("/")[0] in rooms:
                found.append((name, [(line["line_number"], line["count"]) for line in file["lines"]]))
    return found

lines = collections.defaultdict(dict)
with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
    # Notes without an object are of a source that is gone.
    objects = sorted(notes for notes in build.rglob("*.gcno") if notes.with_suffix(".o").exists())
    for found in pool.map(counts_of, objects):
        for name, counts in found:
            for number, count in counts:
                lines[name][number] = max(count, lines[name].get(number, 0))
if not any(count for file in lines.values() for count in file.values()):
    sys.exit("coverage: no program has counts of our sources")
by_folder = collections.defaultdict(lambda: [0, 0])
with open(build / "lines.txt", "w") as rows:
    for name, counts in sorted(lines.items()):
        covered = sum(count > 0 for count in counts.values())
        rows.write(f"{covered:6} of {len(counts):6} {name}\n")
        for key in (name.split("/")[0], "in all"):
            by_folder[key][0] += covered
            by_folder[key][1] += len(counts)
total = by_folder.pop("in all")
for folder, (covered, count) in [*sorted(by_folder.items()), ("in all", total)]:
    print(f"{folder:12} {covered:6} of {count:6} lines, {100 * covered / count:.1f} %")
PYTHON
exit "$status"
