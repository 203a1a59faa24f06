#!/usr/bin/env bash
# Builds and passes the tests: all of them in release, the fast ones under the address and undefined-behaviour sanitizers, those that use
# threads under the thread sanitizer, and a minute of fuzzing.  scripts/test.sh quick: release only, without the slow ones.
set -euo pipefail
cd "$(dirname "$0")/.."

mode=${1:-full}
jobs=${EARSHOT_JOBS:-$(nproc)}
run() { echo "== $*"; "$@"; }

run scripts/build.sh release
if [ "$mode" = quick ]; then
  run ctest --preset release -j "$jobs" -LE slow
  exit
fi
run ctest --preset release -j "$jobs"
for preset in asan-ubsan tsan; do
  run scripts/build.sh "$preset"
  run ctest --preset "$preset" -j "$jobs"
done
run scripts/fuzz.sh 60
