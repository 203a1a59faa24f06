#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/fuzz.sh [--quick] [SECONDS] [TARGET...]
# Builds the fuzz targets (in the preset asan-ubsan) and runs them, all, those of CI (--quick) or the ones named, for SECONDS in all (default 60),
# as many at once as there are cores.  Prints one row per target and exits with 1 if there is a finding; its input is kept in build/fuzz/findings, to be run again with
#   build/asan-ubsan/fuzz/fuzz_TARGET FILE
# What is learnt is kept in build/fuzz/corpus, so that a longer run goes on where the last one stopped.  EARSHOT_JOBS: how many at once.
set -euo pipefail
cd "$(dirname "$0")/.."

built=fuzzers
if [ "${1:-}" = --quick ]; then built=fuzzers_quick; shift; fi
seconds=${1:-60}
[ $# -gt 0 ] && shift
if [ $# -gt 0 ] && [ "$built" = fuzzers_quick ]; then echo "fuzz.sh: --quick runs the targets of CI; name targets without it" >&2; exit 2; fi
jobs=${EARSHOT_JOBS:-$(nproc)}
scripts/build.sh asan-ubsan --target "$built"

programs=build/asan-ubsan/fuzz
build=build/fuzz
targets=("$@")
if [ ${#targets[@]} -eq 0 ] && [ "$built" = fuzzers_quick ]; then
  read -ra targets <"$programs/fuzzers_quick.txt"
elif [ ${#targets[@]} -eq 0 ]; then
  for program in "$programs"/fuzz_*; do
    if [ -x "$program" ] && [ -f "$program" ]; then targets+=("$(basename "$program" | sed 's/^fuzz_//')"); fi
  done
fi
each=$(((seconds * jobs + ${#targets[@]} - 1) / ${#targets[@]}))
if [ "$each" -gt "$seconds" ]; then each=$seconds; fi
# Where CI is set, the same inputs in the same order each time: a commit must not fail by the luck of another.
seed=()
if [ -n "${CI:-}" ]; then seed=(-seed=1); fi
logs=$build/logs findings=$build/findings
rm -rf "$logs" && mkdir -p "$logs" "$findings"

# The sounds and meshes of others are read by libraries that keep or lose memory: cmake/lsan.supp names them.
export ASAN_OPTIONS=detect_leaks=1:allocator_may_return_null=1
export LSAN_OPTIONS=suppressions=$PWD/cmake/lsan.supp:print_suppressions=0
export UBSAN_OPTIONS=print_stacktrace=1

run_one() {
  local name=$1 corpus=$build/corpus/$1 options=()
  mkdir -p "$corpus"
  if [ -f "fuzz/dictionaries/$name.dict" ]; then options+=("-dict=fuzz/dictionaries/$name.dict"); fi
  "$programs/fuzz_$name" -max_total_time="$each" -timeout=60 -rss_limit_mb=2048 -max_len=16384 -print_final_stats=1 "${seed[@]}" \
    -artifact_prefix="$findings/$name-" "${options[@]}" "$corpus" "fuzz/corpus/$name" >"$logs/$name.log" 2>&1 || echo "$name" >>"$logs/failed"
}

running=0
for name in "${targets[@]}"; do
  if [ "$running" -ge "$jobs" ]; then wait -n; running=$((running - 1)); fi
  run_one "$name" &
  running=$((running + 1))
done
wait

printf '%-15s %8s %12s %7s %7s  %s\n' target seconds executions edges corpus findings
total=0
for name in "${targets[@]}"; do
  log=$logs/$name.log
  executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
  edges=$(grep -oE 'cov: [0-9]+' "$log" | tail -n 1 | cut -d' ' -f2 || true)
  corpus=$(grep -oE 'corp: [0-9]+' "$log" | tail -n 1 | cut -d' ' -f2 || true)
  found=none
  if grep -qxF "$name" "$logs/failed" 2>/dev/null; then
    found=$(sed -n 's/.*Test unit written to //p' "$log" | tail -n 1)
    found="${found:-see $log}"
  fi
  total=$((total + ${executions:-0}))
  printf '%-15s %8s %12s %7s %7s  %s\n' "$name" "$each" "${executions:-?}" "${edges:-?}" "${corpus:-?}" "$found"
done
echo "$total executions"
[ ! -f "$logs/failed" ]
