#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Evaluates agents on a benchmark, verifies their results, ranks them and makes replays.
#   scripts/leaderboard.sh [--private SET] BENCHMARK AGENT...
#   BENCHMARK  name of a file in configs/benchmarks ("quick"), or a path
#   AGENT      policy file, checkpoint, run folder, or baseline (random, random_oracle_stop, greedy, classical, oracle), which are run here;
#              or RESULT.json of 'earshot eval --out', of which the actions alone are known and which names its agent.  NAME=AGENT names one that
#              is run here in the table
#   --private  the benchmark's private set, for those who keep it: every agent that is run here is run there too, and the page shows public
#              and private numbers beside each other.  Results on it stay in private/ and are not for the public.
# Results, the page and of each policy the best, median and worst replay go to runs/benchmarks/NAME (EARSHOT_BOARD).
set -euo pipefail
cd "$(dirname "$0")/.."

private=
if [ "${1:-}" = --private ]; then
  private=${2:-}
  shift $(($# > 1 ? 2 : 1))
fi
if [ $# -lt 2 ]; then
  sed -n '3,12s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
benchmark=$1
shift
[ -f "$benchmark" ] || benchmark="configs/benchmarks/$benchmark.yaml"
[ -f "$benchmark" ] || { echo "scripts/leaderboard.sh: $benchmark: no such benchmark" >&2; exit 2; }
earshot=${EARSHOT:-build/release/earshot}
board=${EARSHOT_BOARD:-runs/benchmarks/$(basename "$benchmark" .yaml)}

# Names in the table, before anything is run.
refuse() { echo "scripts/leaderboard.sh: $*" >&2; exit 2; }
names=()
for entry in "$@"; do
  agent=${entry#*=}
  case $agent in
    *.json)
      [ "$agent" = "$entry" ] || refuse "$entry: a result names its agent by itself; leave '${entry%%=*}=' out"
      [ -f "$agent" ] || refuse "$agent: no such result"
      name=$(sed -n '/^ *"agent": "/{s/^ *"agent": "\(.*\)",$/\1/p;q}' "$agent")
      [ -n "$name" ] || refuse "$agent: is no result of 'earshot eval --out'" ;;
    *)
      name=${entry%%=*}
      [ "$name" != "$entry" ] || name=$(basename "${agent%.ckpt}" .policy) ;;
  esac
  for other in "${names[@]}"; do
    [ "$other" != "$name" ] || refuse "$name: two agents of this name; write NAME=AGENT for one that is run here"
  done
  names+=("$name")
done

mkdir -p "$board"
"$earshot" benchmark "$benchmark" ${private:+--private "$private"}
[ -z "$private" ] || mkdir -p -m 700 "$board/private"
results=()
page=()
hidden=()
for i in "${!names[@]}"; do
  name=${names[i]}
  agent=${1#*=}
  shift
  result="$board/$name.json"
  case $agent in
    *.json)
      "$earshot" verify "$agent" --benchmark "$benchmark"
      results+=("$agent")
      continue ;;
  esac
  "$earshot" eval "$agent" --benchmark "$benchmark" --name "$name" --out "$result" >/dev/null
  "$earshot" verify "$result" --benchmark "$benchmark"
  results+=("$result")
  page+=(--run-here "$name")
  if [ -n "$private" ]; then
    "$earshot" eval "$agent" --benchmark "$benchmark" --private "$private" --name "$name" --out "$board/private/$name.json" >/dev/null
    hidden+=(--private-result "$board/private/$name.json")
  fi
  [ -e "$agent" ] || continue # a baseline has no policy
  links=()
  for which in best median worst; do links+=(--link "${name}_$which.html=$which episode"); done
  for which in best median worst; do
    "$earshot" replay "$result" --episode "$which" --policy "$agent" --html "$board/${name}_$which.html" --link "index.html=leaderboard" "${links[@]}"
    page+=(--replay "$name=${name}_$which.html=$which")
  done
done
"$earshot" leaderboard "${results[@]}" --benchmark "$benchmark" ${hidden[@]:+--private "$private" "${hidden[@]}"} --html "$board/index.html" "${page[@]}"
echo "page: $board/index.html"
