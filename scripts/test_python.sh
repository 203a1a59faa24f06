#!/usr/bin/env bash
# scripts/test_python.sh [PYTEST ARGUMENTS...]
# Builds the wheel, installs it with its test dependencies into an environment of its own (build/python_tests), and checks formatting, types and
# behaviour.  Ends with 77 (skipped) where the Python package index cannot be reached or python3 has no venv.
set -euo pipefail
cd "$(dirname "$0")/.."

skip() { echo "test_python: skipped: $*"; exit 77; }
python3 -c 'import venv, ensurepip' 2>/dev/null || skip "python3-venv is missing (scripts/setup.sh)"
python3 -c 'import sysconfig, os, sys; sys.exit(not os.path.exists(os.path.join(sysconfig.get_paths()["include"], "Python.h")))' ||
  skip "python3-dev is missing (scripts/setup.sh)"
tests=build/python_tests
[ -x "$tests/bin/python" ] || python3 -m venv "$tests"
"$tests/bin/pip" install -q --disable-pip-version-check 'gymnasium>=1.0' 'pettingzoo>=1.24' pytest hypothesis mypy ruff ||
  skip "the Python package index cannot be reached"

scripts/build_wheel.sh
"$tests/bin/pip" install -q --disable-pip-version-check --force-reinstall --no-deps build/wheel/*.whl
"$tests/bin/ruff" format --check python
"$tests/bin/ruff" check python
"$tests/bin/mypy"
# From another folder, so that the installed package is what is tested.
root=$PWD
cd "$tests"
bin/python -m pytest -q -c "$root/pyproject.toml" --rootdir "$root" "$root/python/tests" "$@"
