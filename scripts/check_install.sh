#!/usr/bin/env bash
# scripts/check_install.sh [BUILD FOLDER]
# Installs a finished build (default build/release) under a temporary prefix, builds examples/ against it, runs both examples and the installed
# program, and looks into what they write.
set -euo pipefail
cd "$(dirname "$0")/.."

build=$(realpath "${1:-build/release}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
prefix=$work/prefix
fail() { echo "check_install: $*" >&2; exit 1; }
# expect_wav FILE SAMPLES: two channels of SAMPLES 32-bit floats, all finite, one of them at least 0.001.
expect_wav() {
  local start peak
  start=$(($(grep -abo data "$1" | head -n 1 | cut -d: -f1) + 8))
  [ $(($(stat -c %s "$1") - start)) -ge $((2 * $2 * 4)) ] || fail "$1 is shorter than $2 samples"
  [ "$(od -An -tu4 -j $((start - 4)) -N 4 "$1" | tr -d ' ')" = $((2 * $2 * 4)) ] || fail "$1 has not $2 samples"
  peak=$(od -An -v -w4 -tf4 -j "$start" -N $((2 * $2 * 4)) "$1" | awk '/nan|inf/ { bad = 1 } { v = $1 < 0 ? -$1 : $1; if (v > peak) peak = v } END { print bad ? 0 : peak + 0 }')
  awk -v peak="$peak" 'BEGIN { exit !(peak >= 0.001 && peak < 10) }' || fail "$1 has a peak of $peak"
}
# A box of 5 x 3 x 4 m as a mesh file, which the installed reader program reads.
cat >"$work/box.obj" <<'OBJ'
v 0 0 0
v 5 0 0
v 5 3 0
v 0 3 0
v 0 0 4
v 5 0 4
v 5 3 4
v 0 3 4
f 1 2 3 4
f 8 7 6 5
f 5 6 2 1
f 6 7 3 2
f 7 8 4 3
f 8 5 1 4
OBJ

cmake --install "$build" --prefix "$prefix" >/dev/null
cmake -S examples -B "$work/build" -G Ninja -DCMAKE_PREFIX_PATH="$prefix" >/dev/null
cmake --build "$work/build" >"$work/log" || { cat "$work/log" >&2; fail "the examples do not build"; }

"$work/build/rir" shoebox:5x3x4@0.2 "$work/box.wav" 1.2 1.1 1.5 3.8 1.6 2.3
expect_wav "$work/box.wav" 16000
mkdir -p "$prefix/bin"
cp "$work/build/rir" "$prefix/bin/rir"  # finds the reader beside the other installed programs
"$prefix/bin/rir" "$work/box.obj" "$work/mesh.wav" 1.2 1.1 1.5 3.8 1.6 2.3
expect_wav "$work/mesh.wav" 16000
"$work/build/step_batch" house:7 3
if [ -x "$prefix/bin/earshot" ]; then
  "$prefix/bin/earshot" rir "$work/box.obj" --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --set rir_length_s=0.5 --out "$work/program.wav"
  expect_wav "$work/program.wav" 8000
  version=$(sed -nE 's/^project\(.* VERSION ([0-9.]+) .*/\1/p' CMakeLists.txt)
  [ "$("$prefix/bin/earshot" --version)" = "earshot $version" ] || fail "earshot --version is not that of CMakeLists.txt, $version"
  "$prefix/bin/earshot" doctor >"$work/doctor"
  grep -q "^ok *reader *$prefix/libexec/" "$work/doctor" || fail "doctor does not find the installed reader"
fi
echo "check_install: the examples build and run against the installed tree"
