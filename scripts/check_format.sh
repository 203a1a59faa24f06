#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fails if a source file does not name its licence, or differs from what clang-format 14 makes of it (.clang-format).  scripts/check_format.sh --fix
# rewrites the latter.
# Where the distribution has another version, clang-format 14 comes from the Python package index, into build/format_tools; ends with 77 (skipped)
# and one line where that cannot be reached.
set -euo pipefail
cd "$(dirname "$0")/.."

licence='SPDX-License-Identifier: Apache-2.0'
lacking=$(git grep -L --fixed-strings "$licence" -- '*.h' '*.cpp' '*.py' '*.pyi' '*.sh' '*.cmake' '*CMakeLists.txt' || true)
if [ -n "$lacking" ]; then
  echo "format: no line '$licence' at the top of:" >&2
  sed 's/^/  /' <<<"$lacking" >&2
  exit 1
fi

tools=build/format_tools
formatter=
for name in clang-format-14 clang-format "$tools/bin/clang-format"; do
  if command -v "$name" >/dev/null && "$name" --version | grep -qE 'version 14\.'; then formatter=$name; break; fi
done
if [ -z "$formatter" ]; then
  skip() { echo "format: skipped: no clang-format 14 is installed, and $*"; exit 77; }
  [ -x "$tools/bin/pip" ] || python3 -m venv "$tools" 2>/dev/null || skip "python3-venv is missing (scripts/setup.sh)"
  "$tools/bin/pip" install -q --disable-pip-version-check --retries 1 --timeout 20 clang-format==14.0.6 2>"$tools/pip.log" ||
    skip "the Python package index does not give it: $(tail -n 1 "$tools/pip.log")"
  formatter=$tools/bin/clang-format
fi
mapfile -t files < <(git ls-files '*.h' '*.cpp')
if [ "${1:-}" = --fix ]; then
  printf '%s\0' "${files[@]}" | xargs -0 "$formatter" -i
else
  printf '%s\0' "${files[@]}" | xargs -0 -n 50 -P "$(nproc)" "$formatter" --dry-run --Werror
  echo "format: ${#files[@]} files, all as clang-format 14 writes them"
fi
