#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# test_wheels_test.sh PROJECT: which arguments scripts/test_wheels.sh gives to pytest, with a Python that installs nothing and prints what it is asked.
set -euo pipefail
project=$1
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT
mkdir -p "$root/scripts" "$root/python/tests" "$root/build/wheel"
cp "$project/scripts/test_wheels.sh" "$root/scripts/"
echo "numpy==2.0.0" >"$root/python/tests/tested_versions.txt"
touch "$root/build/wheel/earshot-1-cp312-abi3-linux.whl"
cat >"$root/python3" <<'E2'
#!/usr/bin/env bash
case "$*" in
  "-m venv "*) mkdir -p "$3/bin"; cp "$0" "$3/bin/python"; printf '#!/bin/sh\n' >"$3/bin/pip"; chmod +x "$3/bin/pip" ;;
  *cp311-cp311*) echo cp312-abi3 ;;
  *sys.version_info*) echo 3.12.0 ;;
  *gymnasium*) echo 1.0 ;;
  "-m pytest "*) printf '[%s]' "$@" ;;
esac
E2
chmod +x "$root/python3"
failures=0

# check EXPECTED ARGUMENT...: the end of pytest's command line.
check() {
  local expected="[$root/python/tests]$1" log=$root/build/wheel_tests/python3.12.0-numpy2.0.0.log
  shift
  "$root/scripts/test_wheels.sh" --numpy 2.0.0 "$root/python3" "$@" >/dev/null
  [[ "$(cat "$log")" == *"$expected" ]] || { echo "test_wheels_test: expected '$expected' at the end of: $(cat "$log")"; failures=1; }
}
check ""
check "[-k][some name]" -- -k "some name"
check "[-x]" -- -x
exit "$failures"
