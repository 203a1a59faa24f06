#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/test.sh [full|quick|all]
#   full   (default; what CI runs) format, clang-tidy on changed lines (begins no file after 20 s; `all` looks at all of them), the release
#          build and its tests but the slow and long ones, those of the Python package and the documentation site (both skipped with
#          a line where the Python package index cannot be reached), the tests of code that parses outside files under the address and
#          undefined-behaviour sanitizers, those in which threads meet under the thread sanitizer, and a minute of fuzzing
#   quick  the loop while working: builds and runs the tests of the folders with uncommitted changes (of the last commit, if there are none)
#   all    full, the slow tests (label slow: statistics, launchers, sweeps, long benchmarks), the long ones (tests/long_tests*.txt,
#          scripts among them), and all tests under the sanitizers, those of policy, learner and program too; notes date and
#          commit in tests/slow_statistics.txt if the slow tests pass
# The tests of the Python package and the documentation site keep one core busy: they run beside the builds for the sanitizers.
# Ends with the seconds of each stage, the number of tests, failures and skips, and the absent test data that caused skips.
# EARSHOT_JOBS: how many jobs at once (default: all cores, and of tests one more: many of them wait).
set -euo pipefail
cd "$(dirname "$0")/.."

mode=${1:-full}
case $mode in full | quick | all) ;; *) echo "test.sh: unknown mode '$mode'; one of: full, quick, all" >&2; exit 2 ;; esac
jobs=${EARSHOT_JOBS:-$(($(nproc) + 1))}
record=tests/slow_statistics.txt
build=ci left_out='^(slow|long)$' asan_targets=() tsan_targets=() sanitized="" fuzz=(--quick 60) tidy=(--seconds 20)
if [ "$mode" = all ]; then build=release left_out='^slow$' asan_targets=(--target all) tsan_targets=(--target thread_tests test_datasets_threads) sanitized=-all fuzz=(60) tidy=(); fi
table=""
failed=()
beside=""
results=$(mktemp -d)

finish() {
  if [ -n "$beside" ]; then  # after an interrupt
    kill -- "-$beside" 2>/dev/null || true
    wait "$beside" 2>/dev/null || true
    cat "$results/beside.log" 2>/dev/null || true
  fi
  if [ -n "$table" ]; then printf '\n%s%-26s %5d s\n' "$table" "in all" "$SECONDS"; fi
  if compgen -G "$results/*.xml" >/dev/null; then scripts/summarize_tests.sh "$results"/*.xml; fi
  if [ -f "$results/python.log" ]; then echo "  python tests:"; tail -n 12 "$results/python.log" | sed 's/^/      /'; fi
  rm -rf "$results"
}
trap finish EXIT

# stage NAME COMMAND...: runs it, keeps its wall time for the table and its name if it fails; the stages after it run all the same.
stage() {
  local name=$1 begin=$SECONDS status=0
  shift
  echo "== $name: $*"
  "$@" || status=$?
  if [ "$status" -ne 0 ]; then failed+=("$name"); fi
  table+=$(printf '%-26s %5d s%s' "$name" $((SECONDS - begin)) "$([ "$status" -eq 0 ] || echo '   FAILED')")$'\n'
  return "$status"
}

# beside FUNCTION: begins the stages of FUNCTION beside those that follow.  wait_beside waits for them, prints what they wrote, and takes their rows.
beside() {
  set -m  # a process group of its own
  (
    table="" failed=()
    "$1" >"$results/beside.log" 2>&1 </dev/null
    printf '%s' "$table" >"$results/beside.table"
    printf '%s\n' "${failed[@]}" >"$results/beside.failed"
  ) &
  beside=$!
  set +m
}
wait_beside() {
  [ -n "$beside" ] || return 0
  local status=0 names=()
  wait "$beside" || status=$?
  beside=""
  cat "$results/beside.log"
  if [ "$status" -ne 0 ]; then failed+=("beside"); return 0; fi  # ended without its rows
  table+=$(sed 's/$/   beside the builds/' "$results/beside.table")$'\n'
  mapfile -t names < <(grep . "$results/beside.failed" || true)
  failed+=("${names[@]}")
}

# run_tests NAME PRESET [CTEST ARGUMENTS...]
run_tests() { stage "$1" ctest --preset "$2" -j "$jobs" --no-tests=error --output-junit "$results/${1// /_}.xml" --test-output-size-passed 4096 "${@:3}"; }

# The test folders that concern the changed files, one per line, without the leading tests/: the mirror of a source under unit/, or the folder of a
# changed test.  Files that no folder mirrors are named on stderr.
changed_folders() {
  local files file folder
  files=$(git diff --name-only HEAD; git ls-files --others --exclude-standard)
  [ -n "$files" ] || files=$(git diff --name-only HEAD~1 HEAD)
  for file in $files; do
    folder=$(dirname "$file")
    case $folder in
      tests/*) folder=${folder#tests/} ;;
      bench | bench/questions) echo unit/bench; continue ;;
      include/earshot) printf 'unit/api\nunit/api/training\n'; continue ;;
      sim/reader) printf 'unit/sim/base\nunit/sim/scene\n'; continue ;;
      *) folder=unit/$folder ;;
    esac
    while [[ "$folder" == */* ]] && ! compgen -G "tests/$folder/*_test.cpp" >/dev/null; do folder=$(dirname "$folder"); done
    # One program has the tests of these rooms.
    case $folder in
      unit/trainer/net | unit/trainer/launch | unit/trainer/collective) echo "$folder"; continue ;;
      unit/bench/training) echo "$folder"; continue ;;
      unit/sim/base/* | unit/sim/scene/* | unit/sim/audio/* | unit/bench/* | unit/envs/* | unit/trainer/* | unit/evaluation/*) dirname "$folder"; continue ;;
    esac
    if compgen -G "tests/$folder/*_test.cpp" >/dev/null; then echo "$folder"; else echo "test.sh: no test folder mirrors $file" >&2; fi
  done | sort -u
}

# Builds the test programs of these folders and runs them, with the pinned bits where the simulation or the training changed.
run_quick() {
  local folders=("$@") targets=() labels="" folder target
  for folder in "${folders[@]}"; do
    case $folder in
      unit/sim/* | unit/envs | unit/datasets) targets+=(test_pinned); labels+="|pinned" ;;
      unit/policy | unit/trainer | unit/trainer/*) targets+=(test_pinned_training_libtorch); labels+="|pinned/training" ;;
    esac
    labels+="|$folder"
    target=${folder#unit/}
    target=test_${target//\//_}
    case $folder in
      unit/policy | unit/api/training | pinned/training | robustness/training) target+=_libtorch ;;
      unit/trainer) targets+=("${target}_libtorch") ;;
    esac
    if [ -n "$(find "tests/$folder" -name '*_threads_test.cpp' -print -quit)" ]; then targets+=("${target}_threads"); fi
    if [ -n "$(find "tests/$folder" -name '*_test.cpp' ! -name '*_slow_test.cpp' ! -name '*_threads_test.cpp' -print -quit)" ]; then targets+=("$target"); fi
  done
  stage "quick build" scripts/build.sh release --target "${targets[@]}" && run_tests "quick tests" release -LE slow -L "^(${labels#|})\$" || true
}

# or_skipped COMMAND...: runs it; skipped is not failed.
or_skipped() {
  local status=0
  "$@" || status=$?
  [ "$status" -eq 77 ] || return "$status"
}

# Skipped is not failed.  Of a failure the last lines stay for the end of the log.
test_python() {
  local status=0
  scripts/test_python.sh 2>&1 | tee "$results/python.log" || status=$?
  if [ "$status" -eq 0 ] || [ "$status" -eq 77 ]; then rm "$results/python.log"; return 0; fi
  return "$status"
}

# One core each, for the most part.
run_python_and_docs() {
  stage "python tests" test_python || true
  stage "docs" or_skipped scripts/docs.sh || true
}

run_full() {
  local has_release="" has_asan="" has_tsan=""
  stage "format" or_skipped scripts/check_format.sh || true
  stage "tidy" or_skipped scripts/tidy.py "${tidy[@]}" || true
  if stage "release build" scripts/build.sh "$build"; then
    run_tests "release tests" release -LE "$left_out" || true
    if [ "$mode" = all ] && run_tests "slow tests" release -L slow; then
      printf 'The slow tests (scripts/test.sh all) last passed on %s at commit %s.\n' "$(date -u +%Y-%m-%d)" "$(git describe --always --abbrev=12 --dirty)" >"$record"
    fi
    has_release=1
  fi
  if [ "$mode" = all ] && stage "asan training build" scripts/build.sh asan-ubsan-training; then
    run_tests "asan training tests" asan-ubsan-training || true
  fi
  if [ -n "$has_release" ]; then beside run_python_and_docs; fi
  stage "asan-ubsan build" scripts/build.sh asan-ubsan "${asan_targets[@]}" && has_asan=1
  stage "tsan build" scripts/build.sh tsan "${tsan_targets[@]}" && has_tsan=1
  wait_beside
  if [ -n "$has_asan" ]; then
    run_tests "asan-ubsan tests" "asan-ubsan$sanitized" || true
    stage "fuzzing" scripts/fuzz.sh "${fuzz[@]}" || true
  fi
  if [ -n "$has_tsan" ]; then run_tests "tsan tests" "tsan$sanitized" || true; fi
}

if [ "$mode" = quick ]; then
  mapfile -t folders < <(changed_folders)
  if [ ${#folders[@]} -eq 0 ]; then echo "test.sh: no changed file has unit tests"; exit; fi
  run_quick "${folders[@]}"
else
  run_full
  cat "$record"
fi
if [ ${#failed[@]} -gt 0 ]; then
  printf 'test.sh: failed: %s\n' "$(IFS=,; echo "${failed[*]}")" >&2
  exit 1
fi
