#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# stages_test.sh TEST_SH: checks that scripts/test.sh fails if any stage fails, including those that run in the background, and that a skipped
# stage is not a failure.  Stand-in scripts take the place of what the stages call.
set -euo pipefail
script=$1
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT
mkdir -p "$root/scripts" "$root/tests" "$root/bin"
cp "$script" "$root/scripts/test.sh"
for name in check_format.sh tidy.py build.sh test_python.sh docs.sh fuzz.sh summarize_tests.sh ../bin/ctest; do
  cat >"$root/scripts/$name" <<'END'
#!/usr/bin/env bash
echo "stage: $(basename "$0") $*"
if [ "$(basename "$0") ${1:-}" = "$FAILING" ] || [ "$(basename "$0") ${2:-}" = "$FAILING" ]; then
  if [ "$CODE" = killed ]; then kill -KILL "$PPID"; fi
  exit "$CODE"
fi
END
  chmod +x "$root/scripts/$name"
done
git -C "$root" init -q
: >"$root/tests/slow_statistics.txt"
failures=0

# expect STATUS SAID FAILING CODE: the script ends so, and says that, where one of its stages ends with CODE, or kills the shell that began it.
expect() {
  local status=0 said
  said=$(FAILING=$3 CODE=$4 PATH=$root/bin:$PATH "$root/scripts/test.sh" 2>&1) || status=$?
  if [ "$status" != "$1" ] || ! grep -qE -- "$2" <<<"$said"; then echo "stages_test: $3 ends with $4: status $status: $(tail -n 20 <<<"$said")"; failures=1; fi
  for stage in "ctest --preset release" "test_python.sh" "docs.sh" "tidy.py" "build.sh asan-ubsan" "ctest --preset asan-ubsan" "build.sh tsan" \
    "ctest --preset tsan" "fuzz.sh"; do
    # What needs a build that failed does not run.
    if [[ "$3" != build.sh* ]] && ! grep -qF "stage: $stage" <<<"$said"; then echo "stages_test: $3 ends with $4: no $stage"; failures=1; fi
  done
}
expect 0 '^in all' 'none' 0
expect 1 'failed: format$' 'check_format.sh ' 1
expect 1 'failed: tidy$' 'tidy.py --seconds' 1
expect 1 'failed: release tests$' 'ctest release' 8
expect 1 'failed: asan-ubsan tests$' 'ctest asan-ubsan' 8
expect 1 'failed: python tests$' 'test_python.sh ' 1
expect 1 'failed: docs$' 'docs.sh ' 1
expect 1 '^docs +[0-9]+ s +FAILED' 'docs.sh ' 1
expect 1 'failed: fuzzing$' 'fuzz.sh --quick' 1
expect 1 'failed: tsan tests$' 'ctest tsan' 8
expect 1 'failed: release build$' 'build.sh ci' 1
expect 1 'failed: asan-ubsan build$' 'build.sh asan-ubsan' 1
expect 1 'failed: tsan build$' 'build.sh tsan' 1
expect 1 'failed: beside$' 'docs.sh ' killed  # the shell of the stages beside
for stage in 'check_format.sh ' 'test_python.sh ' 'docs.sh '; do expect 0 '^in all' "$stage" 77; done
exit "$failures"
