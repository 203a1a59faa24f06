#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/soak.sh [OPTIONS of `earshot bench soak`]
# A million environment steps through 200 generated scenes, hard ones among them: about 25 minutes on two quiet cores.  Watches memory,
# observations, heard energy and step times; report, numbers and plot go to $EARSHOT_SOAK_OUT (default runs/soak).  Exit code 1 if a bound
# is broken.
set -euo pipefail
cd "$(dirname "$0")/.."

launcher=()
command -v ccache >/dev/null && launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
cmake --preset release "${launcher[@]}" >/dev/null
cmake --build --preset release --target earshot -- -j "${EARSHOT_JOBS:-$(nproc)}"
build/release/earshot bench soak --out "${EARSHOT_SOAK_OUT:-runs/soak}" "$@"
