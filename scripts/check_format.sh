#!/usr/bin/env bash
# Fails if a source file differs from what clang-format 14 makes of it (.clang-format).  scripts/check_format.sh --fix rewrites them.
set -euo pipefail
cd "$(dirname "$0")/.."

formatter=
for name in clang-format-14 clang-format; do
  if command -v "$name" >/dev/null && "$name" --version | grep -qE 'version 14\.'; then formatter=$name; break; fi
done
if [ -z "$formatter" ]; then echo "format: clang-format 14 is missing: apt-get install clang-format-14 (or run scripts/setup.sh)" >&2; exit 1; fi
mapfile -t files < <(git ls-files '*.h' '*.cpp')
if [ "${1:-}" = --fix ]; then
  printf '%s\0' "${files[@]}" | xargs -0 "$formatter" -i
else
  printf '%s\0' "${files[@]}" | xargs -0 -n 50 -P "$(nproc)" "$formatter" --dry-run --Werror
  echo "format: ${#files[@]} files, all as clang-format 14 writes them"
fi
