#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/check_install.sh [BUILD FOLDER]
# Installs a finished build (default build/release) under a temporary prefix, builds examples/ against it (one for each public header), runs them and
# the installed program, and looks into what they print and write.
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
# The public headers, and no other.
(cd include && find . -name '*.h' | sort) >"$work/public"
(cd "$prefix/include" && find . -type f | sort) >"$work/installed"
training=
grep -q '/train\.h$' "$work/installed" && training=1
[ -n "$training" ] || sed -i -E '/\/(policy|train)\.h$/d' "$work/public"
diff "$work/public" "$work/installed" >&2 || fail "the installed headers are not those of include/"

cmake -S examples -B "$work/build" -G Ninja -DCMAKE_PREFIX_PATH="$prefix" >/dev/null
cmake --build "$work/build" >"$work/log" || { cat "$work/log" >&2; fail "the examples do not build"; }
# Each header but vec3.h, which all others bring, has an example of its name.
while IFS= read -r header; do
  name=$(basename "$header" .h)
  [ "$name" = vec3 ] || [ -x "$work/build/$name" ] || fail "no example shows earshot/$name.h"
done <"$work/installed"

# A program that was linked with the library of the build runs with the installed one.
compat=$(find "$prefix" -name libRLRAudioPropagation.so -printf '%h\n' -quit)
if [ -x "$build/tests/compat_program" ] && [ -n "$compat" ]; then
  LD_LIBRARY_PATH=$compat ldd "$build/tests/compat_program" | grep -q " $compat/" || fail "the installed libRLRAudioPropagation.so is not the one that runs"
  LD_LIBRARY_PATH=$compat "$build/tests/compat_program" "$work/compat" >"$work/said" 2>/dev/null || { cat "$work/said" >&2; fail "a program fails with the installed libRLRAudioPropagation.so"; }
fi

ran=0
# prints PATTERN EXAMPLE ARGUMENTS...: the example ends well, and a line that it prints matches the extended regular expression.
prints() {
  local pattern=$1 name=$2
  shift 2
  "$work/build/$name" "$@" >"$work/said" 2>"$work/errors" || { cat "$work/said" "$work/errors" >&2; fail "the example $name fails"; }
  grep -qE "$pattern" "$work/said" || { cat "$work/said" >&2; fail "the example $name prints no line '$pattern'"; }
  ran=$((ran + 1))
}
version=$(scripts/check_version.sh --print)
prints "^earshot ${version//./\\.}\$" version
prints '^5 of 5 refused$' errors
prints '^rays: 64$' config rays=64
prints '^rir \[2, [0-9]+\] at 16000 Hz$' scene house:7
prints '^facing the listener is [1-9][0-9]?\.[0-9] dB louder' source
prints ' 2 channels, 16000 samples at 16000 Hz, [1-9][0-9]* paths' rir shoebox:5x3x4@0.2 "$work/box.wav" 1.2 1.1 1.5 3.8 1.6 2.3
expect_wav "$work/box.wav" 16000
prints '^t20_s .* 0\.[0-9]{3}$' metrics
prints ' 2 channels of [0-9]+ frames, read back equal$' audio "$work/speech.wav"
prints '^160 x 120 pixels, depth 0?[0-9.]+ to [0-9.]+ m$' camera "$work/seen.png"
[ "$(head -c 4 "$work/seen.png" | tail -c 3)" = PNG ] || fail "the example camera writes no PNG file"
prints ' m on foot by [0-9]+ corners, ' navigation
prints '^step  2  rewards' env house:7 3
prints '^6 episodes, read back equal$' episodes "$work/episodes.json.gz"
prints ': 6 responses written, 6 in the corpus, 0 folders missing$' dataset "$work/corpus"
prints ': 0 responses written, 6 in the corpus, 0 folders missing$' dataset "$work/corpus"
if [ -n "$training" ]; then
  prints '^40 steps of 4 envs: ' policy configs/policies/quick.policy 40
  mkdir "$work/training"
  prints '^success of the oracle 1\.000$' train "$work/training" 64
fi
mkdir -p "$prefix/bin"
cp "$work/build/rir" "$prefix/bin/rir"  # finds the reader beside the other installed programs
"$prefix/bin/rir" "$work/box.obj" "$work/mesh.wav" 1.2 1.1 1.5 3.8 1.6 2.3 >/dev/null
expect_wav "$work/mesh.wav" 16000
if [ -x "$prefix/bin/earshot" ]; then
  "$prefix/bin/earshot" rir "$work/box.obj" --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --set rir_length_s=0.5 --out "$work/program.wav"
  expect_wav "$work/program.wav" 8000
  [ "$("$prefix/bin/earshot" --version)" = "earshot $version" ] || fail "earshot --version is not that of CMakeLists.txt, $version"
  "$prefix/bin/earshot" doctor >"$work/doctor"
  grep -q "^ok *reader *$prefix/libexec/" "$work/doctor" || fail "doctor does not find the installed reader"
fi
echo "check_install: $(wc -l <"$work/installed") headers installed; $(find examples -name '*.cpp' | wc -l) examples build and run against them ($ran runs)"
