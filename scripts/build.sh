#!/usr/bin/env bash
# scripts/build.sh [PRESET] [CTEST ARGUMENTS...]
# Configures and builds one preset (release, debug, asan-ubsan, tsan, fuzz; default release).  With further arguments it also runs ctest with them:
#   scripts/build.sh release -R PathTracer
set -euo pipefail
cd "$(dirname "$0")/.."

preset=${1:-release}
[ $# -gt 0 ] && shift
launcher=()
command -v ccache >/dev/null && launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
cmake --preset "$preset" "${launcher[@]}"
cmake --build --preset "$preset" -- -j "${EARSHOT_JOBS:-$(nproc)}"
if [ $# -gt 0 ]; then ctest --preset "$preset" "$@"; fi
