#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Which agents does the given leaderboard.sh refuse, and does it so before it runs one?  The program it calls only notes that it was called.
set -euo pipefail
script=$1
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT

cat > "$root/earshot" <<END
#!/bin/sh
echo "\$*" >> "$root/calls"
END
chmod +x "$root/earshot"
touch "$root/test.yaml"
printf '{\n "earshot_result": 1,\n "agent": "walker",\n "policy_hash": ""\n}\n' > "$root/first.json"
cp "$root/first.json" "$root/second.json"
echo '{}' > "$root/other.json"

failures=0
fail() { echo "leaderboard_test: $*"; failures=1; }
board() { rm -f "$root/calls"; EARSHOT=$root/earshot EARSHOT_BOARD=$root/board "$script" "$root/test.yaml" "$@" > "$root/stdout" 2> "$root/stderr"; }
refuses() {  # refuses TEXT AGENT...
  local status=0 text=$1
  shift
  board "$@" || status=$?
  [ "$status" = 2 ] || fail "$*: status $status, expected 2"
  grep -qF -- "$text" "$root/stderr" || fail "$*: no '$text' in: $(cat "$root/stderr")"
  [ ! -e "$root/calls" ] || fail "$*: ran before it refused: $(cat "$root/calls")"
}
refuses "leave 'mine=' out" "mine=$root/first.json"
refuses "walker: two agents of this name" "$root/first.json" "$root/second.json"
refuses "walker: two agents of this name" walker=greedy "$root/first.json"
refuses "greedy: two agents of this name" greedy greedy
refuses "no such result" "$root/third.json"
refuses "is no result" "$root/other.json"

board quick=greedy oracle "$root/first.json" || fail "agents of different names: $(cat "$root/stderr")"
grep -qF -- "eval greedy --benchmark $root/test.yaml --name quick --out $root/board/quick.json" "$root/calls" || fail "greedy is not run as quick"
grep -qF -- "leaderboard $root/board/quick.json $root/board/oracle.json $root/first.json --benchmark $root/test.yaml --html $root/board/index.html --run-here quick --run-here oracle" "$root/calls" ||
  fail "wrong table: $(cat "$root/calls")"
exit "$failures"
