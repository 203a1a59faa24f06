#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The given release.sh --check passes on a tree that can be released, and names what is wrong with others.
set -euo pipefail
release=$1
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT
export GIT_CONFIG_GLOBAL=/dev/null GIT_AUTHOR_NAME=test GIT_AUTHOR_EMAIL=test@test.invalid GIT_COMMITTER_NAME=test GIT_COMMITTER_EMAIL=test@test.invalid
failures=0
complain() { echo "release_test: $*"; failures=1; }

fresh() {
  rm -rf "$root/tree"; mkdir "$root/tree"; cd "$root/tree"
  git init -q .
  printf 'project(earshot VERSION 3.20.1 LANGUAGES CXX)\n' >CMakeLists.txt
  printf '# Changelog\n\n## [3.20.1] - 2031-02-03\n\n- new\n' >CHANGELOG.md
  printf 'version: 3.20.1\ndate-released: 2031-02-03\n' >CITATION.cff
  touch LICENSE README.md SECURITY.md
  commit
}
commit() { git add -A; git commit -q -m change; }
# expect STATUS WORDS [ARGUMENT...]
expect() {
  local status=0 output words=$2 expected=$1
  shift 2
  output=$(EARSHOT_TREE=$root/tree "$release" --check "$@" 2>&1) || status=$?
  [ "$status" = "$expected" ] || complain "$words: status $status, expected $expected: $output"
  [[ "$output" == *"$words"* ]] || complain "expected '$words' in: $output"
  [ ! -e "$root/tree/build" ] || complain "--check builds"
}
fresh; expect 0 "3.20.1 can be released from $(git rev-parse --short HEAD)"
fresh; git tag v3.20.0; expect 0 "can be released"
fresh; git tag v3.20.1; expect 1 "the tag v3.20.1 exists"
fresh; echo more >>README.md; expect 1 "1 files differ from the commit, the first is README.md"
fresh; touch left_over; expect 1 "left_over"
fresh; sed -i 's/2031-02-03/Unreleased/' CHANGELOG.md; commit; expect 1 "is Unreleased"
fresh; sed -i 's/3.20.1/3.21.0/' CMakeLists.txt; commit; expect 1 "CHANGELOG.md has no line '## [3.21.0]"
fresh; sed -i 's/3.20.1/3.20.0/' CITATION.cff; commit; expect 1 "CITATION.cff has version '3.20.0'"
fresh; echo 'version 3.20.1' >setup.py; commit; expect 1 "setup.py:1:version 3.20.1"
fresh; rm SECURITY.md; commit; expect 1 "SECURITY.md is missing"
fresh; expect 2 "unknown argument '--chekc'" --chekc
fresh; expect 2 "'none' is none" --debs none
if command -v dpkg-deb >/dev/null; then
  for version in 3.20.1-1 3.20.0-1; do
    mkdir -p "$root/deb/DEBIAN" "$root/debs"
    printf 'Package: earshot\nVersion: %s\nArchitecture: all\nMaintainer: test <test@test.invalid>\nDescription: test\n' $version >"$root/deb/DEBIAN/control"
    dpkg-deb --build "$root/deb" "$root/debs/a.deb" >/dev/null
    fresh
    if [ $version = 3.20.1-1 ]; then expect 0 "can be released" --debs "$root/debs"; else expect 1 "a.deb has version 3.20.0-1" --debs "$root/debs"; fi
  done
fi
exit "$failures"
