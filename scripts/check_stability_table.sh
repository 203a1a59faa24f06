#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Every hard case H-1 to H-75 has a row in docs/evidence/stability.md, and every test that this page or docs/evidence/precision.md names exists
# in tests/.
set -euo pipefail
cd "$(dirname "$0")/.."

page=docs/evidence/stability.md
pages=("$page" docs/evidence/precision.md)
failed=0
for case in $(seq 1 75); do
  grep -qE "^\|[^|]*\bH-$case\b[^|]*\|" "$page" || { echo "$page: no row for H-$case"; failed=1; }
done

# Suites and full names as the sources define them.
defined=$(grep -rhoE '^(TEST|TEST_F|TEST_P)\([A-Za-z0-9_]+, *[A-Za-z0-9_]+\)' tests | sed -E 's/^TEST(_F|_P)?\(//; s/, */./; s/\)$//')
suites=$(cut -d. -f1 <<<"$defined" | sort -u)
# Names stand in backquotes in the last column of a table.
named=$(grep -hE '^\|' "${pages[@]}" | awk -F'|' '{print $(NF-1)}' | grep -oE '`[A-Za-z0-9_.]+`' | tr -d '`' | sort -u || true)
for name in $named; do
  if [[ $name == *.* ]]; then list=$defined; else list=$suites; fi
  grep -qxF "$name" <<<"$list" || { echo "$page or precision.md: no such test: $name"; failed=1; }
done

count=$(grep -cE '^\| *[A-Z]' "$page" || true)
[ "$failed" -eq 0 ] && echo "$page: $count rows, $(wc -w <<<"$named") tests named, all there"
exit "$failed"
