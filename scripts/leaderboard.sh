#!/usr/bin/env bash
# Evaluates agents on a benchmark, verifies their results and ranks them.
#   scripts/leaderboard.sh BENCHMARK AGENT...
#   BENCHMARK  name of a file in configs/benchmarks ("quick"), or a path
#   AGENT      policy file, checkpoint, run folder, or baseline (random, random_oracle_stop, greedy, classical, oracle); NAME=AGENT names it in the table
# Results and the page go to runs/benchmarks/NAME (EARSHOT_BOARD).
set -euo pipefail
cd "$(dirname "$0")/.."

if [ $# -lt 2 ]; then
  sed -n '2,6s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
benchmark=$1
shift
[ -f "$benchmark" ] || benchmark="configs/benchmarks/$benchmark.yaml"
[ -f "$benchmark" ] || { echo "scripts/leaderboard.sh: $benchmark: no such benchmark" >&2; exit 2; }
earshot=${EARSHOT:-build/release/earshot}
board=${EARSHOT_BOARD:-runs/benchmarks/$(basename "$benchmark" .yaml)}
mkdir -p "$board"

"$earshot" benchmark "$benchmark"
results=()
for entry in "$@"; do
  agent=${entry#*=}
  name=${entry%%=*}
  [ "$name" != "$entry" ] || name=$(basename "${agent%.ckpt}" .policy)
  result="$board/$name.json"
  for other in "${results[@]}"; do
    [ "$other" != "$result" ] || { echo "scripts/leaderboard.sh: $name: two agents of this name; write NAME=AGENT" >&2; exit 2; }
  done
  "$earshot" eval "$agent" --benchmark "$benchmark" --name "$name" --out "$result" >/dev/null
  "$earshot" verify "$result" --benchmark "$benchmark"
  results+=("$result")
done
"$earshot" leaderboard "${results[@]}" --benchmark "$benchmark" --html "$board/index.html"
echo "page: $board/index.html"
