#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/train.sh [--overwrite | --resume] [CONFIG] [key=value...]
# The main job on a bare machine: install, build, generate houses and episodes, train with the config's workers, evaluate the checkpoint on
# held-out houses and sounds beside five baselines, verify the results, print the leaderboard and write pages: the leaderboard, and the best,
# median and worst episode of the agent by SPL as replays, linked from each other.  CONFIG defaults to configs/train/quick.yaml.
# What comes out is in runs/NAME of the config's file.  If a run is there already the script stops before it changes anything:
#   --overwrite  replaces that run and its results
#   --resume     goes on with it, with the episodes it has, and evaluates it anew
set -euo pipefail
cd "$(dirname "$0")/.."

mode=new
case "${1:-}" in
  --overwrite | --resume) mode=${1#--}; shift ;;
  -*) echo "scripts/train.sh: unknown option $1 (--overwrite or --resume)" >&2; exit 2 ;;
esac
config=configs/train/quick.yaml
if [ $# -gt 0 ]; then config=$1; shift; fi
sets=()
for override in "$@"; do sets+=(--set "$override"); done
name=$(basename "$config" .yaml)
out=runs/$name
for override in "$@"; do
  case $override in out=*) echo "scripts/train.sh: $override: results go to $out; copy the config to train into another folder" >&2; exit 2 ;; esac
done
if [ "$mode" = new ] && { compgen -G "$out/checkpoints/*.ckpt" || compgen -G "$out/*.ckpt"; } >/dev/null; then
  echo "scripts/train.sh: $out contains an earlier run; continue it with --resume, or replace it with --overwrite" >&2
  exit 2
fi

if [ -z "${EARSHOT_SKIP_SETUP:-}" ]; then scripts/setup.sh; fi
launcher=()
command -v ccache >/dev/null && launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
cmake --preset release "${launcher[@]}" >/dev/null
cmake --build --preset release --target earshot -- -j "${EARSHOT_JOBS:-$(nproc)}"
earshot=build/release/earshot

mkdir -p "$out"
"$earshot" doctor
start=()
if [ "$mode" = resume ]; then
  start=(--resume "$out")
else
  [ "$mode" = overwrite ] && start=(--overwrite)
  echo "== episodes"
  "$earshot" dataset episodes --config "$config" "${sets[@]}"
fi
echo "== train"
"$earshot" train "$config" "$@" out="$out" "${start[@]}"
# Results are of one run: those of an earlier one go before they could be ranked beside the new.
rm -f "$out"/result_{"$name",random,random_oracle_stop,greedy,classical,oracle}.json "$out/leaderboard.html" "$out"/replay_{best,median,worst}.html
# A run that evaluates itself on data.held_out has chosen its best checkpoint by that.
agent=$out
if grep -q '"held_out/' "$out/events.jsonl"; then agent=$out/checkpoints/best.ckpt; fi
echo "== evaluate"
"$earshot" eval "$agent" --out "$out/result_$name.json"
for baseline in random random_oracle_stop greedy classical oracle; do
  "$earshot" eval "$baseline" --config "$config" "${sets[@]}" --out "$out/result_$baseline.json"
done
results=("$out/result_$name.json" "$out"/result_{random,random_oracle_stop,greedy,classical,oracle}.json)
echo "== verify"
"$earshot" verify "${results[@]}" --config "$config" "${sets[@]}"
echo "== leaderboard"
links=()
for which in best median worst; do links+=(--link "replay_$which.html=replay: $which episode"); done
"$earshot" leaderboard "${results[@]}" --html "$out/leaderboard.html" "${links[@]}"
echo "== replays"
for which in best median worst; do
  "$earshot" replay "$out/result_$name.json" --episode "$which" --policy "$agent" --html "$out/replay_$which.html" \
    --link "leaderboard.html=leaderboard" "${links[@]}"
done
echo "pages: $out/leaderboard.html, $out/replay_best.html, $out/replay_median.html, $out/replay_worst.html"
