#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Edit, build, test: builds only the test programs that WHAT needs, and runs only its tests.
#
#   scripts/dev.sh WHAT...                 for example:
#   scripts/dev.sh sim/acoustics/paths/utd.cpp                 the tests of a source
#   scripts/dev.sh tests/unit/sim/audio/head/hrtf_test.cpp     those of a test file
#   scripts/dev.sh Hrtf.RatesAbove*                            tests by name
#   scripts/dev.sh envs/sensors                                all tests of a folder
#
#   --list          print programs and tests, build nothing
#   --preset NAME   default: release; debug compiles a changed source alone, without its group
#
# EARSHOT_JOBS: how many jobs at once (default: all cores).
set -euo pipefail
cd "$(dirname "$0")/.."

usage() { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; }
preset=release list=
while [ $# -gt 0 ]; do
  case $1 in
    --list) list=1 ;;
    --preset) preset=${2:?dev: --preset needs a name}; shift ;;
    -h | --help) usage; exit ;;
    -*) echo "dev: unknown option $1 (scripts/dev.sh --help)" >&2; exit 2 ;;
    *) break ;;
  esac
  shift
done
if [ $# -eq 0 ]; then usage >&2; exit 2; fi

build=build/$preset
configure() { cmake --preset "$preset" >/dev/null; }
[ -f "$build/compile_commands.json" ] || configure
status=0
programs=$(python3 scripts/find_tests.py "$build" "$@") || status=$?
# A test file that is new to the build.
if [ "$status" -eq 3 ]; then
  configure
  status=0
  programs=$(python3 scripts/find_tests.py "$build" "$@") || status=$?
fi
[ "$status" -eq 0 ] || exit 2
if [ -n "$list" ]; then echo "$programs"; exit; fi

begin=$SECONDS
mapfile -t targets < <(cut -d ' ' -f 1 <<<"$programs")
cmake --build "$build" --target "${targets[@]}" -- -j "${EARSHOT_JOBS:-$(nproc)}"
built=$((SECONDS - begin))
while read -r target filter; do
  "$build/tests/$target" --gtest_brief=1 --gtest_filter="$filter" || status=1
done <<<"$programs"
echo "dev: ${targets[*]}: built in $built s, tests in $((SECONDS - begin - built)) s"
exit "$status"
