#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# dependencies_page_test.sh CHECK: whether check_dependencies.sh sees what is wrong in a copy of docs/dependencies.md: a version, a licence, a row that
# is missing, and one of a package that setup.sh does not install.
set -euo pipefail
check=$1
command -v dpkg-query >/dev/null || exit 77
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT
sed -E 's/^(\| libembree-dev \|) 3\.13\.5/\1 3.13.4/; s/^(\| zlib1g-dev .*) Zlib \|/\1 MIT |/; /^\| libhdf5-dev /d; s/^\| ninja-build /| ninjas /' \
  "$(dirname "$check")/../docs/dependencies.md" >"$root/page.md"
if EARSHOT_DEPENDENCIES_PAGE="$root/page.md" "$check" 2>"$root/errors"; then echo "dependencies_page_test: five mistakes pass"; exit 1; fi
failures=0
for text in "libembree-dev in the versions 3.13.4" "zlib1g-dev under 'MIT'" "no row of libhdf5-dev" "no row of ninja-build" "a row of ninjas"; do
  grep -qF "$text" "$root/errors" || { echo "dependencies_page_test: no word of: $text"; cat "$root/errors"; failures=1; }
done
exit "$failures"
