#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/build.sh [PRESET] [--target NAME...] [-- CTEST ARGUMENTS...]
# Configures and builds one preset (release, ci, debug, asan-ubsan, asan-ubsan-training, tsan, coverage; default release) or the
# named targets of it, with ccache where it is installed; ci is release without the slow tests and the small benchmarks, in the
# same folder.  With further arguments it also runs ctest with them:
#   scripts/build.sh release --target test_sim_nav -- -R Navmesh
# Of asan-ubsan the tests and fuzz targets of CI are built (--target all: all of them), of asan-ubsan-training the tests of what
# needs libtorch and of the program, of tsan the tests in which threads meet.
set -euo pipefail
cd "$(dirname "$0")/.."

preset=${1:-release}
[ $# -gt 0 ] && shift
targets=()
if [ "${1:-}" = --target ]; then
  targets=(--target)
  shift
  while [ $# -gt 0 ] && [ "$1" != -- ]; do targets+=("$1"); shift; done
fi
if [ "${1:-}" = -- ]; then shift; fi
# Without these ccache keeps nothing that reads precompiled headers.
export CCACHE_SLOPPINESS=${CCACHE_SLOPPINESS:-pch_defines,time_macros}
# Paths below here count as relative, so that clones share what they have compiled.
export CCACHE_BASEDIR=${CCACHE_BASEDIR:-$PWD} CCACHE_NOHASHDIR=${CCACHE_NOHASHDIR:-1}
launcher=()
command -v ccache >/dev/null && launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
# The sanitizers take the clang of the distribution: 14 in Debian 12, 19 in Debian 13.  What needs libtorch takes g++: clang 14 refuses
# the headers of libtorch 1.13 in C++20.  In a folder of another compiler's, CMake would forget what the preset sets, the sanitizer
# first of all.
fresh=()
compiler=()
case $preset in
  asan-ubsan | tsan) for wanted in clang++-14 clang++-19 clang++; do if command -v "$wanted" >/dev/null; then break; fi; done ;;
  asan-ubsan-training | coverage) wanted=g++ ;;
  *) wanted= ;;
esac
if [ -n "$wanted" ]; then
  compiler=(-DCMAKE_CXX_COMPILER="$wanted")
  grep -qs "^CMAKE_CXX_COMPILER:.*[=/]$wanted\$" "build/$preset/CMakeCache.txt" || fresh=(--fresh)
fi
cmake --preset "$preset" "${fresh[@]}" "${compiler[@]}" "${launcher[@]}" >/dev/null
cmake --build --preset "$preset" "${targets[@]}" -- -j "${EARSHOT_JOBS:-$(nproc)}"
if [ $# -gt 0 ]; then ctest --preset "$preset" "$@"; fi
