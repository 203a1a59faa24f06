#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The given check_version.sh passes on a tree whose files agree, and refuses each way in which they can disagree.
set -euo pipefail
check=$1
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT
failures=0
complain() { echo "version_test: $*"; failures=1; }

# A tree of the version 3.20.1, as a repository.
fresh() {
  rm -rf "$root/tree"; mkdir "$root/tree"; cd "$root/tree"
  git init -q .
  printf 'cmake_minimum_required(VERSION 3.25)\nproject(earshot VERSION 3.20.1 LANGUAGES CXX)\n' >CMakeLists.txt
  printf '# Changelog\n\n## [3.20.1] - 2031-02-03\n\n- new\n\n## [3.20.0] - 2030-01-01\n\n- old\n' >CHANGELOG.md
  printf 'title: "Earshot"\nversion: 3.20.1\ndate-released: "2031-02-03"\n' >CITATION.cff
  # None of these is the version of this project: parts of longer ones, an address, a pinned package.
  printf '13.20.1 3.20.10 3.20.1.7 4.3.20.1 name==3.20.1 v3.2.1\n' >other.md
  git add .
}
# expect STATUS WORDS: of the check in that tree.
expect() {
  local status=0 output
  git add .
  output=$(EARSHOT_TREE=$root/tree "$check" 2>&1) || status=$?
  [ "$status" = "$1" ] || complain "$2: status $status, expected $1: $output"
  [[ "$output" == *"$2"* ]] || complain "expected '$2' in: $output"
}
fresh; expect 0 "version: 3.20.1 in CMakeLists.txt"
[ "$(EARSHOT_TREE=$root/tree "$check" --print)" = 3.20.1 ] || complain "--print prints something else"
fresh; sed -i 's/3\.20\.1 LANG/3.21.0 LANG/' CMakeLists.txt; expect 1 "CHANGELOG.md has no line '## [3.21.0]"
fresh; sed -i 's/project(.*/project(earshot LANGUAGES CXX)/' CMakeLists.txt; expect 1 "CMakeLists.txt has no line"
fresh; printf '\n## [3.20.1] - 2031-02-03\n' >>CHANGELOG.md; expect 1 "or two"
fresh; sed -i 's/^- new/## [3.20.2] - Unreleased\n/; s/^## \[3.20.1\].*/- first/' CHANGELOG.md; expect 1 "CHANGELOG.md"
fresh; sed -i 's/2031-02-03/2031-2-3/' CHANGELOG.md; expect 1 "CHANGELOG.md has no line"
fresh; printf '# C\n\n## [3.21.0] - Unreleased\n\n' | cat - CHANGELOG.md >c && mv c CHANGELOG.md; expect 1 "the section of 3.20.1 comes first"
fresh; sed -i 's/^version.*/version: 3.20.0/' CITATION.cff; expect 1 "CITATION.cff has version '3.20.0'"
fresh; sed -i 's/^date.*/date-released: 2031-02-04/' CITATION.cff; expect 1 "CITATION.cff has date-released '2031-02-04'"
for line in 'pip install earshot-3.20.1.whl' 'version = "3.20.1"' 'earshot_3.20.1_amd64.deb' 'in v3.20.1.'; do
  fresh; echo "$line" >page.md; expect 1 "page.md:1:$line"
done
# A section that is still Unreleased needs no date in CITATION.cff.
fresh; sed -i 's/2031-02-03/Unreleased/' CHANGELOG.md; expect 0 "(Unreleased)"
exit "$failures"
