#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Tracked files cite only what the repository holds: no document outside it is named, every page of docs/ that is named exists, and every place
# on it: a section N (a heading "N" or "N.M"), docs/evidence/oracles.md, O-N (a heading), docs/evidence/stability.md, H-N (a row).
set -euo pipefail
cd "$(dirname "$0")/.."
git rev-parse --is-inside-work-tree >/dev/null   # what is tracked is checked
failed=0
fail() { echo "citations: $1"; failed=1; }

# Documents that are not here.  The letters in brackets keep this file from naming them.
outside='\b(O[R]ACLES|D[E]SIGN\.md|F[A]CTS|T[R]AINER\.md|E[C]OSYSTEM\.md|S[T]YLE\.md|V[O]CABULARY\.md)\b|[Dd]esign [c]ard|[Dd]esign [p]age'
while IFS= read -r line; do fail "names a document outside the repository: $line"; done < <(git grep -nE "$outside" || true)
# Of the folder beside the repository only its data may be named.
while IFS= read -r line; do fail "names a file outside the repository: $line"; done \
  < <(git grep -nE '\.\./s[h]ared/[A-Za-z0-9_.-]+' | grep -vE '\.\./s[h]ared/(data\b|a\.\.b)' || true)

# One line per citation, comments joined over line breaks: file, page, place, with tabs between.
citations() {
  git grep -lE '\bdocs/[A-Za-z0-9_/-]+\.md' -- ':!CHANGELOG.md' | while IFS= read -r file; do
    sed -E 's#^[[:space:]]*(///?<?|\#|\*)?[[:space:]]*##' "$file" | tr '\n' ' ' | tr -s ' ' |
      grep -oE '\bdocs/[A-Za-z0-9_/-]+\.md(, (sections? [0-9.]*[0-9]|[OH]-[0-9]+))?' | sed -E "s#^docs/([A-Za-z0-9_/-]+\.md)(, )?#$file	\1	#"
  done | sort -u
}
count=0
while IFS=$'\t' read -r file page place; do
  count=$((count + 1))
  if [ ! -f "docs/$page" ]; then fail "$file names docs/$page, which does not exist"; continue; fi
  case $place in
    section*)
      number=${place##* }
      grep -qE "^#+ ${number//./\\.} " "docs/$page" || fail "$file names docs/$page, $place: no such heading" ;;
    O-*) grep -qE "^## $place " "docs/$page" || fail "$file names docs/$page, $place: no such heading" ;;
    H-*) grep -qE "^\|[^|]*\b$place\b[^|]*\|" "docs/$page" || fail "$file names docs/$page, $place: no such row" ;;
  esac
done < <(citations)

# Links between pages.
while IFS=: read -r file target; do
  target=${target%%#*}
  [ -z "$target" ] || [ -e "$(dirname "$file")/$target" ] || fail "$file links to $target, which does not exist"
done < <(git grep -oE '\]\([^)]+\)' -- '*.md' | sed -E 's/\]\(([^)]*)\)$/\1/' | grep -vE ':(https?|mailto):' || true)

[ "$failed" -eq 0 ] && echo "citations: $count places of docs/ are named, all there"
exit "$failed"
