#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The version of Earshot stands in CMakeLists.txt.  Fails if CHANGELOG.md has no section of it, if CITATION.cff has another version or another date
# than that section, or if a further tracked file states it: there it would be forgotten at the next release.
# scripts/check_version.sh --print prints the version.
set -euo pipefail
cd "${EARSHOT_TREE:-$(dirname "$0")/..}"  # EARSHOT_TREE: another checkout, for tests

version=$(sed -nE 's/^project\(earshot VERSION ([0-9]+\.[0-9]+\.[0-9]+) .*/\1/p' CMakeLists.txt)
[ -n "$version" ] || { echo "check_version: CMakeLists.txt has no line 'project(earshot VERSION X.Y.Z ...'" >&2; exit 1; }
if [ "${1:-}" = --print ]; then echo "$version"; exit 0; fi

failed=0
complain() { echo "check_version: $*" >&2; failed=1; }

section=$(grep -E "^## \[${version//./\\.}\] - ([0-9]{4}-[0-9]{2}-[0-9]{2}|Unreleased)\$" CHANGELOG.md || true)
[ "$(grep -c . <<<"$section")" = 1 ] || complain "CHANGELOG.md has no line '## [$version] - YYYY-MM-DD', or two; add the section of this version"
first=$(grep -m 1 -E '^## \[' CHANGELOG.md || true)
[ "$first" = "$section" ] || complain "CHANGELOG.md begins with '$first'; the section of $version comes first"
date=${section##* - }

# cite KEY: its value in CITATION.cff, without quotes.
cite() { sed -nE "s/^$1: *[\"']?([^\"']*)[\"']?\$/\\1/p" CITATION.cff; }
[ "$(cite version)" = "$version" ] || complain "CITATION.cff has version '$(cite version)'; write $version, as CMakeLists.txt has it"
if [ "$date" != Unreleased ]; then
  [ "$(cite date-released)" = "$date" ] || complain "CITATION.cff has date-released '$(cite date-released)'; write $date, as CHANGELOG.md has it"
fi

# A word of its own, and no version of a package that is pinned (NAME==VERSION).
pattern="(?<![0-9.=])\\Q$version\\E(?![0-9.]*[0-9])"
others=$(git grep -nIP "$pattern" -- . ':(exclude)CMakeLists.txt' ':(exclude)CHANGELOG.md' ':(exclude)CITATION.cff' || [ $? -eq 1 ])
if [ -n "$others" ]; then
  complain "the version stands in further files; take it from CMakeLists.txt there:"
  sed 's/^/  /' <<<"$others" >&2
fi
[ "$failed" = 0 ] && echo "version: $version in CMakeLists.txt, CHANGELOG.md ($date) and CITATION.cff alone"
exit "$failed"
