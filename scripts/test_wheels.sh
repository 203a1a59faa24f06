#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/test_wheels.sh [--numpy VERSION]... PYTHON... [-- PYTEST ARGUMENTS...]
# Installs the wheel of build/wheel that fits each Python into a new environment with each NumPy (default: 1.26.4 and the one of
# python/tests/tested_versions.txt), and runs python/tests there.  Writes a line per pair to build/wheel_tests/table.md.
# A NumPy without a wheel for a Python is a line that says so; a failed test is a line and status 1.  Status 77 and one line where pip has no
# connection to the Python package index, 2 where a Python or its wheel is missing (scripts/build_wheel.sh PYTHON...).
set -euo pipefail
cd "$(dirname "$0")/.."

numpys=() pythons=() arguments=()
while [ $# -gt 0 ]; do
  case $1 in
    --numpy) numpys+=("${2:?--numpy needs a version}"); shift 2 ;;
    --) shift; arguments=("$@"); break ;;
    -*) sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
    *) pythons+=("$1"); shift ;;
  esac
done
[ ${#pythons[@]} -gt 0 ] || pythons=(python3)
newest=$(sed -n 's/^numpy==//p' python/tests/tested_versions.txt)
[ ${#numpys[@]} -gt 0 ] || numpys=(1.26.4 "$newest")
root=$PWD
work=$root/build/wheel_tests
mkdir -p "$work"
printf '| Python | NumPy | wheel | Gymnasium | tests |\n|---|---|---|---|---|\n' >"$work/table.md"
failed=0

# install ENVIRONMENT NUMPY WHEEL: pip's words go to ENVIRONMENT.log.
install() {
  "$1/bin/pip" install -q --disable-pip-version-check --retries 1 --timeout 20 --only-binary numpy "numpy==$2" "$3[gym]" \
    pettingzoo matplotlib omegaconf pytest hypothesis xxhash pygame array-api-compat opencv-python-headless moviepy networkx >"$1.log" 2>&1
}

for python in "${pythons[@]}"; do
  version=$("$python" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])') || exit 2
  tag=$("$python" -c 'import sys; print("cp311-cp311" if sys.version_info < (3, 12) else "cp312-abi3")')
  wheel=$(compgen -G "build/wheel/*-$tag-*.whl" | head -n 1 || true)
  [ -n "$wheel" ] || { echo "test_wheels: build/wheel has no wheel $tag: scripts/build_wheel.sh $python" >&2; exit 2; }
  for numpy in "${numpys[@]}"; do
    environment=$work/python$version-numpy$numpy
    rm -rf "$environment"
    "$python" -m venv "$environment"
    if ! install "$environment" "$numpy" "$root/$wheel"; then
      if grep -qE "connection broken by|Max retries exceeded|ConnectionError" "$environment.log"; then
        echo "test_wheels: skipped: the Python package index cannot be reached"
        exit 77
      fi
      grep -q "No matching distribution found for numpy" "$environment.log" || { cat "$environment.log" >&2; failed=1; }
      printf '| %s | %s | `%s` | | cannot be installed together |\n' "$version" "$numpy" "$tag" >>"$work/table.md"
      continue
    fi
    gymnasium=$("$environment/bin/python" -c 'import gymnasium; print(gymnasium.__version__)')
    # From another folder, so that the sources are not what is imported.
    status=0
    (cd "$environment" && bin/python -m pytest -q -p no:cacheprovider -c "$root/pyproject.toml" --rootdir "$root" \
      "$root/python/tests" ${arguments[@]+"${arguments[@]}"}) >>"$environment.log" 2>&1 || status=$?
    [ "$status" -eq 0 ] || { failed=1; tail -n 30 "$environment.log" >&2; }
    printf '| %s | %s | `%s` | %s | %s |\n' "$version" "$numpy" "$tag" "$gymnasium" "$(tail -n 1 "$environment.log")" >>"$work/table.md"
  done
done
cat "$work/table.md"
exit "$failed"
