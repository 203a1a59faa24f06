#!/usr/bin/env bash
# scripts/test.sh [full|quick|all]
#   full   (default; what CI runs) format, the release build and its tests without the slow statistics, the tests under the address and
#          undefined-behaviour sanitizers, those in which threads meet under the thread sanitizer, and a minute of fuzzing
#   quick  the loop while working: builds and runs the tests of the folders with uncommitted changes (of the last commit, if there are none)
#   all    full, and the slow statistics (label slow); notes date and commit in tests/slow_statistics.txt if all pass
# Prints the seconds of each stage at the end.  EARSHOT_JOBS: how many jobs at once (default: all cores).
set -euo pipefail
cd "$(dirname "$0")/.."

mode=${1:-full}
case $mode in full | quick | all) ;; *) echo "test.sh: unknown mode '$mode'; one of: full, quick, all" >&2; exit 2 ;; esac
jobs=${EARSHOT_JOBS:-$(nproc)}
record=tests/slow_statistics.txt
table=""

# stage NAME COMMAND...: runs it and keeps its wall time for the table.
stage() {
  local name=$1 begin=$SECONDS
  shift
  echo "== $name: $*"
  "$@"
  table+=$(printf '%-26s %5d s' "$name" $((SECONDS - begin)))$'\n'
}

# Folders under tests/unit that mirror the changed sources, one per line.
changed_folders() {
  local files file folder
  files=$(git diff --name-only HEAD; git ls-files --others --exclude-standard)
  [ -n "$files" ] || files=$(git diff --name-only HEAD~1 HEAD)
  for file in $files; do
    folder=$(dirname "$file")
    folder=${folder#tests/unit/}
    while [ "$folder" != . ] && ! compgen -G "tests/unit/$folder/*_test.cpp" >/dev/null; do folder=$(dirname "$folder"); done
    [ "$folder" = . ] || echo "$folder"
  done | sort -u
}

# Builds the test programs of these folders and runs them, with the pinned bits where the simulation changed.
run_quick() {
  local folders=("$@") targets=() labels="" folder target
  for folder in "${folders[@]}"; do
    case $folder in sim/* | envs) targets+=(test_pinned); labels+="|pinned" ;; policy | trainer) targets+=(test_pinned_training); labels+="|pinned/training" ;; esac
    labels+="|unit/$folder"
    target=test_${folder//\//_}
    if compgen -G "tests/unit/$folder/*_threads_test.cpp" >/dev/null; then targets+=("${target}_threads"); fi
    if ls "tests/unit/$folder" | grep -E '_test\.cpp$' | grep -qvE '_(slow|threads)_test\.cpp$'; then targets+=("$target"); fi
  done
  stage "quick build" scripts/build.sh release --target "${targets[@]}"
  stage "quick tests" ctest --preset release -j "$jobs" -LE slow -L "^(${labels#|})\$"
}

run_full() {
  stage "format" scripts/check_format.sh
  stage "release build" scripts/build.sh release
  stage "release tests" ctest --preset release -j "$jobs" -LE slow
  stage "asan-ubsan build" scripts/build.sh asan-ubsan
  stage "asan-ubsan tests" ctest --preset asan-ubsan -j "$jobs"
  stage "tsan build" scripts/build.sh tsan
  stage "tsan tests" ctest --preset tsan -j "$jobs"
  stage "fuzzing" scripts/fuzz.sh 60
}

if [ "$mode" = quick ]; then
  mapfile -t folders < <(changed_folders)
  if [ ${#folders[@]} -eq 0 ]; then echo "test.sh: no changed file has unit tests"; exit; fi
  run_quick "${folders[@]}"
else
  run_full
  if [ "$mode" = all ]; then
    stage "slow statistics" ctest --preset release -j "$jobs" -L slow
    printf 'The slow statistics (scripts/test.sh all) last passed on %s at commit %s.\n' "$(date -u +%Y-%m-%d)" "$(git rev-parse --short=12 HEAD)" >"$record"
  fi
  cat "$record"
fi
printf '\n%s%-26s %5d s\n' "$table" "in all" "$SECONDS"
