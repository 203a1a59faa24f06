#!/usr/bin/env bash
# scripts/train.sh [CONFIG] [key=value...]
# The main job on a bare machine: install, build, generate houses and episodes, train with the config's workers, evaluate the checkpoint on
# held-out houses and sounds beside three baselines, print the leaderboard.  CONFIG defaults to configs/train/quick.yaml.
set -euo pipefail
cd "$(dirname "$0")/.."

config=configs/train/quick.yaml
if [ $# -gt 0 ]; then config=$1; shift; fi
sets=()
for override in "$@"; do sets+=(--set "$override"); done

if [ -z "${EARSHOT_SKIP_SETUP:-}" ]; then scripts/setup.sh; fi
launcher=()
command -v ccache >/dev/null && launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
cmake --preset release "${launcher[@]}" >/dev/null
cmake --build --preset release --target earshot -- -j "${EARSHOT_JOBS:-$(nproc)}"
earshot=build/release/earshot

name=$(basename "$config" .yaml)
out=runs/$name
mkdir -p "$out"
"$earshot" doctor
echo "== episodes"
"$earshot" dataset episodes --config "$config" "${sets[@]}"
echo "== train"
"$earshot" train "$config" "$@" out="$out"
echo "== evaluate"
"$earshot" eval "$out" --out "$out/result_$name.json"
for baseline in random greedy oracle; do
  "$earshot" eval "$baseline" --config "$config" "${sets[@]}" --out "$out/result_$baseline.json"
done
echo "== leaderboard"
"$earshot" leaderboard "$out/result_$name.json" "$out"/result_{random,greedy,oracle}.json --html "$out/leaderboard.html"
