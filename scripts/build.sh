#!/usr/bin/env bash
# scripts/build.sh [PRESET] [CTEST ARGUMENTS...]
# Configures and builds one preset (release, debug, asan-ubsan, tsan, fuzz; default release).  With further arguments it also runs ctest with them:
#   scripts/build.sh release -R PathTracer
# Of tsan only the tests are built in which threads meet.
set -euo pipefail
cd "$(dirname "$0")/.."

preset=${1:-release}
[ $# -gt 0 ] && shift
launcher=()
command -v ccache >/dev/null && launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
# In a folder of another compiler's, CMake would forget what the preset sets, the sanitizer first of all.
fresh=()
case $preset in asan-ubsan | tsan | fuzz)
  grep -qs '^CMAKE_CXX_COMPILER:.*=.*clang++-14$' "build/$preset/CMakeCache.txt" || fresh=(--fresh) ;;
esac
cmake --preset "$preset" "${fresh[@]}" "${launcher[@]}"
cmake --build --preset "$preset" -- -j "${EARSHOT_JOBS:-$(nproc)}"
if [ $# -gt 0 ]; then ctest --preset "$preset" "$@"; fi
