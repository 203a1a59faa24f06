#!/usr/bin/env bash
# scripts/coverage.sh [CTEST ARGUMENTS...]
# On Debian 12: builds the preset `coverage` (clang 14), runs its tests (all but the slow and long ones, or those that the
# arguments choose) and prints, by folder, how many lines of code they run.  build/coverage/lines.txt has a row per source.
# Exit status: that of the tests.  EARSHOT_JOBS: how many jobs at once (default: all cores).
set -euo pipefail
cd "$(dirname "$0")/.."

for tool in clang++-14 llvm-profdata-14 llvm-cov-14; do
  command -v "$tool" >/dev/null || { echo "coverage: $tool is missing: scripts/setup.sh installs it on Debian 12" >&2; exit 2; }
done
build=build/coverage
rm -rf "$build/profiles"
scripts/build.sh coverage
status=0
ctest --preset coverage -j "${EARSHOT_JOBS:-$(nproc)}" "$@" || status=$?

llvm-profdata-14 merge -sparse -o "$build/profile" "$build"/profiles/*.profraw
objects=()
while read -r program; do objects+=(-object "$program"); done < <(
  find "$build" -maxdepth 2 -type f -perm -u+x \( -name 'test_*' -o -name 'earshot*' \) | sort)
llvm-cov-14 export -summary-only -instr-profile "$build/profile" "${objects[@]}" >"$build/coverage.json"
python3 - "$build/coverage.json" "$build/lines.txt" <<'PYTHON'
import collections, json, os, sys
files = json.load(open(sys.argv[1]))["data"][0]["files"]
root = os.getcwd() + "/"
by_folder = collections.defaultdict(lambda: [0, 0])
with open(sys.argv[2], "w") as rows:
    for file in files:
        # -fmacro-prefix-map leaves paths from the root.
        name = file["filename"].removeprefix(root)
        folder = name.split("/")[0]
        if folder not in ("sim", "envs", "datasets", "policy", "trainer", "evaluation", "bench", "apps"):
            continue
        lines = file["summary"]["lines"]
        rows.write(f"{lines['covered']:6} of {lines['count']:6} {name}\n")
        for key in (folder, "in all"):
            by_folder[key][0] += lines["covered"]
            by_folder[key][1] += lines["count"]
total = by_folder.pop("in all", None)
if total is None:
    sys.exit("coverage: no program has counts of our sources")
for folder, (covered, count) in [*sorted(by_folder.items()), ("in all", total)]:
    print(f"{folder:12} {covered:6} of {count:6} lines, {100 * covered / count:.1f} %")
PYTHON
exit "$status"
