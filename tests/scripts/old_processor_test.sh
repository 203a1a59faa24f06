#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# old_processor_test.sh PROGRAM...
# What do programs that are compiled for x86-64-v3 say on processors before it, which qemu plays?  One line that names what is missing, and exit
# status 1; a signal would say nothing.  On a processor that has it all, no such line.
set -euo pipefail
qemu=$(command -v qemu-x86_64-static || command -v qemu-x86_64) || { echo "old_processor_test: skipped: no qemu-user-static"; exit 77; }
failures=0
complain() { echo "old_processor_test: $*"; failures=1; }

# run PROCESSOR PROGRAM: its output without qemu's own warnings in $output, its status in $status.
run() {
  status=0
  output=$("$qemu" -cpu "$1" "$2" --version 2>&1) || status=$?
  output=$(grep -v '^qemu-x86_64[^:]*: warning' <<<"$output" || true)
}
for program in "$@"; do
  while read -r processor lacks; do
    run "$processor" "$program"
    line="earshot: this build of Earshot uses instructions that this processor does not have ($lacks); build it with -DEARSHOT_ARCH=x86-64"
    [ "$status" = 1 ] || complain "$program on $processor: status $status, expected 1"
    [ "$output" = "$line" ] || complain "$program on $processor says: $output"
  done <<'ROWS'
qemu64 SSE4.2, AVX, AVX2, BMI2, FMA
Nehalem AVX, AVX2, BMI2, FMA
SandyBridge AVX2, BMI2, FMA
max,-fma FMA
ROWS
  run max "$program"
  [[ $status -lt 128 && "$output" != *"this processor does not have"* ]] || complain "$program on a processor with everything: status $status, $output"
done
exit "$failures"
