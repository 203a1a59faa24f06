#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Which failures of pip does the given test_python.sh take for an index out of reach?  A copy of it, in a tree where pip fails with a given answer.
set -euo pipefail
python3 -c 'import venv, ensurepip, sysconfig, os, sys; sys.exit(not os.path.exists(os.path.join(sysconfig.get_paths()["include"], "Python.h")))' ||
  { echo "python_index_test: skipped: python3-venv or python3-dev is missing"; exit 77; }
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT
mkdir -p "$root"/scripts "$root"/python/tests "$root"/build/python_tests/bin
cp "$1" "$root/scripts/test_python.sh"
bin=$root/build/python_tests/bin
printf '#!/bin/sh\ncat "%s" >&2\nexit 1\n' "$root/answer" > "$bin/pip"
ln -s "$(command -v python3)" "$bin/python"
chmod +x "$bin/pip"

failures=0
expect() {  # expect STATUS NAME; the answer on standard input
  local status=0
  cat > "$root/answer"
  "$root/scripts/test_python.sh" > "$root/output" 2>&1 || status=$?
  if [ "$status" != "$1" ]; then echo "python_index_test: $2: status $status, expected $1"; cat "$root/output"; failures=1; fi
}
refused="WARNING: Retrying (Retry(total=0, connect=None, read=None, redirect=None, status=None)) after connection broken by 'NewConnectionError('<pip._vendor.urllib3.connection.HTTPSConnection object at 0x7f>: Failed to establish a new connection: [Errno 111] Connection refused')': /simple/nanobind/"
none="ERROR: Could not find a version that satisfies the requirement nanobind (from versions: none)
ERROR: No matching distribution found for nanobind"
conflict="ERROR: Cannot install nanobind because these package versions have conflicting dependencies.
ERROR: ResolutionImpossible: for help visit https://pip.pypa.io/en/latest/topics/dependency-resolution/#dealing-with-dependency-conflicts"
full="ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device"
expect 77 "connection refused" <<<"$refused
$none"
expect 77 "connection refused, with a wanted version" <<<"$refused
$conflict"
expect 77 "no name" <<<"${refused/Errno 111] Connection refused/Errno -3] Temporary failure in name resolution}
$none"
expect 77 "no proxy" <<<"${refused/NewConnectionError/ProxyError(\'Cannot connect to proxy.\', NewConnectionError}
$none"
expect 77 "a certificate that this machine does not know" <<<"${refused/NewConnectionError/SSLError}
$conflict"
expect 77 "a file out of reach" <<<"ERROR: Could not install packages due to an OSError: HTTPSConnectionPool(host='files', port=443): Max retries exceeded with url: /a.whl (Caused by NewConnectionError('Failed to establish a new connection'))"
expect 1 "disk full" <<<"$full"
expect 1 "disk full after a broken connection" <<<"$refused
$full"
expect 1 "broken environment" <<<"Traceback (most recent call last):
ModuleNotFoundError: No module named 'pip'"
expect 1 "a package that the index lacks" <<<"$none"
expect 1 "a wanted version that the index lacks" <<<"$conflict"
expect 1 "a version that the index lacks" <<<"ERROR: Could not find a version that satisfies the requirement nanobind==99 (from versions: 0.0.1, 3.1.0)
ERROR: No matching distribution found for nanobind==99"
expect 1 "a version that the index lacks, after a broken connection" <<<"$refused
ERROR: Could not find a version that satisfies the requirement nanobind==99 (from versions: 0.0.1, 3.1.0)
ERROR: No matching distribution found for nanobind==99"
exit "$failures"
