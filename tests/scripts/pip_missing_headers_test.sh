#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# pip_missing_headers_test.sh PROJECT: what `pip install PROJECT` says on a machine without the packages.  The headers are hidden by a compiler that
# looks for them in another folder.  pip takes nothing from an index: the check comes before anything that is installed there.
set -euo pipefail
project=$1
python3 -c 'import venv, ensurepip' 2>/dev/null || { echo "pip_missing_headers_test: skipped: python3-venv is missing"; exit 77; }
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT
python3 -m venv "$root/venv"
mkdir "$root/include"
cat >"$root/c++" <<E2
#!/bin/sh
printf '#include "..." search starts here:\n#include <...> search starts here:\n %s\nEnd of search list.\n' "$root/include" >&2
E2
chmod +x "$root/c++"
failures=0
complain() { echo "pip_missing_headers_test: $*"; cat "$root/output"; failures=1; }

# install: pip, with the compiler above; its words without the margin that pip puts before those of the backend go to the file output.
install() {
  if env -u CMAKE_PREFIX_PATH -u CONDA_PREFIX CXX="$root/c++" "$root/venv/bin/pip" install --disable-pip-version-check --no-index --no-deps \
    --no-build-isolation "$project" >"$root/output" 2>&1; then
    complain "pip installs without headers"
  fi
}
# The backend says one line, whatever pip puts around it.
install
lines=$(grep -c "earshot: missing" "$root/output" || true)
[ "$lines" = 1 ] || complain "$lines lines say what is missing, expected 1"
line=$(grep -m 1 "earshot: missing" "$root/output" || true)
for word in embree4/rtcore.h samplerate.h zlib.h "apt-get install libembree-dev libtbb-dev" libspdlog-dev "or run scripts/setup.sh"; do
  [[ "$line" == *"$word"* ]] || complain "the line does not name $word"
done
for word in Traceback CMake "No module named"; do ! grep -q "$word" "$root/output" || complain "says '$word' too"; done
grep -qE '\[1 lines? of output\]' "$root/output" || complain "the backend says more than one line"

# Headers that are there are not named.
mkdir -p "$root/include/tbb" "$root/include/embree3"
touch "$root/include/tbb/parallel_for.h" "$root/include/embree3/rtcore.h" "$root/include/zlib.h"
install
line=$(grep -m 1 "earshot: missing" "$root/output" || true)
[[ "$line" == *"apt-get install libmeshoptimizer-dev"* ]] || complain "the first package is not libmeshoptimizer-dev"
for word in rtcore.h libtbb-dev zlib; do [[ "$line" != *"$word"* ]] || complain "names $word, which is there"; done

# Without any compiler that is what is named first.
rm "$root/c++"
install
grep -q "earshot: missing a C++ compiler" "$root/output" || complain "no word of the compiler"
exit "$failures"
