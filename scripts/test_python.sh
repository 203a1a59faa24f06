#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/test_python.sh [--wheel] [PYTEST ARGUMENTS...]
# Checks formatting, types and behaviour of the Python package, with gymnasium's and pettingzoo's own checks, in an environment of its own
# (build/python_tests).  What is tested is the extension as a target of the release build, which takes sim and envs from there, or with --wheel the
# wheel of scripts/build_wheel.sh, installed.
# Takes the versions of python/tests/tested_versions.txt, so that a new release of a tool changes no result.
# Tests of the adapters skip where their framework is missing, as it is here: python/tests/test_frameworks.py says how to run them.
# EARSHOT_PROGRAM: a program whose bits are compared with the package's (default: the one of the release build, if it is there).
# Ends with 77 (skipped) and one line where pip has no connection to the Python package index, or does not know the certificate there, or
# python3 has no venv or headers.
# EARSHOT_JOBS: how many jobs at once (default: all cores).
set -euo pipefail
cd "$(dirname "$0")/.."

wheel=
if [ "${1:-}" = --wheel ]; then wheel=1; shift; fi
root=$PWD
tests=$root/build/python_tests

skip() { echo "test_python: skipped: $*"; exit 77; }
# index_is_out_of_reach ANSWER: whether pip says that it has no connection, and no error but those that follow from this.
index_is_out_of_reach() {
  local broken follows
  # A certificate that this machine does not know stands between as well.
  broken='(New|HTTPS?)ConnectionError|NameResolutionError|ConnectTimeoutError|ReadTimeoutError|ProtocolError|ProxyError|SSLError'
  grep -qE "connection broken by '($broken)|Max retries exceeded.*($broken)" <<<"$1" || return 1
  # A package of which the index says nothing has no version, and none that python/tests/tested_versions.txt wants.
  follows="from versions: none\)|No matching distribution found|have conflicting dependencies|ResolutionImpossible|Max retries exceeded.*($broken)"
  ! grep '^ERROR: ' <<<"$1" | grep -vE "$follows" >/dev/null
}
python3 -c 'import venv, ensurepip' 2>/dev/null || skip "python3-venv is missing (scripts/setup.sh)"
python3 -c 'import sysconfig, os, sys; sys.exit(not os.path.exists(os.path.join(sysconfig.get_paths()["include"], "Python.h")))' ||
  skip "python3-dev is missing (scripts/setup.sh)"
[ -x "$tests/bin/python" ] || python3 -m venv "$tests"
if ! answer=$("$tests/bin/pip" install -q --disable-pip-version-check --retries 1 --timeout 20 -c python/tests/tested_versions.txt \
  nanobind gymnasium hydra-core matplotlib omegaconf onnx onnxruntime pettingzoo pytest hypothesis mypy ruff xxhash pygame opencv-python-headless moviepy array-api-compat networkx pyarrow scipy soundfile 2>&1); then
  echo "$answer" >&2
  # A full disk, a broken environment, or an index that answers but lacks a version is a failure.
  index_is_out_of_reach "$answer" || exit 1
  skip "the Python package index cannot be reached"
fi

"$tests/bin/ruff" format --check python
"$tests/bin/ruff" check python
"$tests/bin/mypy"

if [ -n "$wheel" ]; then
  scripts/build_wheel.sh "$tests/bin/python"
  "$tests/bin/pip" install -q --disable-pip-version-check --force-reinstall --no-deps build/wheel/*.whl
else
  # Whatever becomes of the tests, the next configure of the release build asks for no Python.  A trap that fails would end the script with its own
  # status.
  trap '(cd "$root" && cmake --preset release -DEARSHOT_PYTHON=OFF >/dev/null)' EXIT
  cmake --preset release -DEARSHOT_PYTHON=ON -DPython_EXECUTABLE="$tests/bin/python" >/dev/null
  scripts/build.sh release --target python_package
  export PYTHONPATH=$root/build/release/python_package
  if [ -x build/release/earshot ]; then export EARSHOT_PROGRAM=${EARSHOT_PROGRAM:-$root/build/release/earshot}; fi
fi
# earshot_asr is tested with the torch of the distribution, in an environment that sees its packages; without it, tests of networks skip.
asr=$tests
system_numpy=$(/usr/bin/python3 -c 'import torch, numpy; print(numpy.__version__)' 2>/dev/null) || system_numpy=
if [ -n "$system_numpy" ]; then
  asr=$root/build/asr_tests
  [ -x "$asr/bin/python" ] || /usr/bin/python3 -m venv --system-site-packages "$asr"
  # That torch wants the numpy of the distribution, and this a scipy that knows it.
  "$asr/bin/pip" install -q --disable-pip-version-check --retries 1 --timeout 20 "numpy==$system_numpy" scipy==1.15.3 \
    $(grep -iE '^(pytest|soundfile|pyyaml)==' python/tests/tested_versions.txt) pyyaml
fi
# From another folder, so that the sources are not what is imported.
cd "$tests"
bin/python -m pytest -q -p no:cacheprovider -c "$root/pyproject.toml" --rootdir "$root" "$root/python/tests" "$@"
# Arguments choose among the tests of the package.
[ $# -eq 0 ] || exit 0
PYTHONPATH=$root/python/earshot_asr \
  "$asr/bin/python" -m pytest -q -p no:cacheprovider -c "$root/pyproject.toml" --rootdir "$root" "$root/python/earshot_asr/tests"
