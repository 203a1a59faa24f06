#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the documentation site: build/docs/html/index.html, which needs no network to read.
#
#   scripts/docs.sh            build what has changed
#   scripts/docs.sh --fresh    forget the last build first
#
# Pages come from docs/ (scripts/site/navigation.md orders them), the reference of C++ from Doxygen, that of Python from the docstrings, those of
# commands and config keys from the program.  A warning of Sphinx or Doxygen and a broken link are errors.
# EARSHOT_PROGRAM: the program to ask (default: build/release/earshot, which is built if it is not there).
# Ends with 77 (skipped) and one line where Doxygen or venv is missing or pip has no connection to the Python package index.
set -euo pipefail
cd "$(dirname "$0")/.."

build=$PWD/build/docs
case ${1:-} in
  "") ;;
  --fresh) rm -rf "$build/source" "$build/html" "$build/doctrees" "$build/doxygen" ;;
  *) sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
esac

skip() { echo "docs: skipped: $*"; exit 77; }
command -v doxygen >/dev/null || skip "doxygen is missing (scripts/setup.sh)"
python3 -c 'import venv, ensurepip' 2>/dev/null || skip "python3-venv is missing (scripts/setup.sh)"
pins=scripts/site/requirements.txt
if ! cmp -s "$pins" "$build/venv/installed.txt"; then
  [ -x "$build/venv/bin/pip" ] || python3 -m venv "$build/venv"
  # All packages are pinned, those of packages too.
  if ! answer=$("$build/venv/bin/pip" install -q --disable-pip-version-check --no-deps --retries 1 --timeout 20 -r "$pins" 2>&1); then
    echo "$answer" >&2
    grep -qE "connection broken by '|Max retries exceeded|ConnectionError|ConnectTimeoutError" <<<"$answer" || exit 1
    skip "the Python package index cannot be reached"
  fi
  cp "$pins" "$build/venv/installed.txt"
fi

program=${EARSHOT_PROGRAM:-build/release/earshot}
if [ -z "${EARSHOT_PROGRAM:-}" ] && [ ! -x "$program" ]; then scripts/build.sh release --target earshot; fi
python=$build/venv/bin/python
version=$(sed -nE 's/^project\(earshot VERSION ([0-9.]+).*/\1/p' CMakeLists.txt)
source=$build/source
export PYTHONDONTWRITEBYTECODE=1
export EARSHOT_DOCS_VERSION=$version EARSHOT_DOCS_XML=$build/doxygen/xml EARSHOT_DOCS_STATIC=$source/_static

"$python" scripts/site/commands.py "$program" "$source/reference/commands"
"$python" scripts/site/cpp_headers.py "$source/reference/cpp" "$EARSHOT_DOCS_XML"
"$python" scripts/site/python_package.py "$build/python/earshot" "$version" "$source/reference/python.rst"
"$python" scripts/site/config_keys.py "$program" "$source/reference/config.md"
"$python" scripts/site/pages.py "$source"
PYTHONPATH=$build/python "$python" -m sphinx -b html -c scripts/site -d "$build/doctrees" -j auto -q -W --keep-going "$source" "$build/html"
"$python" scripts/site/check_html.py "$build/html"
echo "docs: build/docs/html/index.html"
