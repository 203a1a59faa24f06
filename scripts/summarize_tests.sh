#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/summarize_tests.sh JUNIT.xml...
# Sums up what ctest --output-junit wrote (one file per preset): which test data were absent and how many tests each file cost, which tests failed and
# in what assertion (at the very end, where a cut log still has them), then one line: tests, failures, skips.  A test that ran under several presets
# counts once for each.
set -euo pipefail

cat "$@" | awk '
  function unescape(text) { gsub(/&lt;/, "<", text); gsub(/&gt;/, ">", text); gsub(/&quot;/, "\"", text); gsub(/&amp;/, "\\&", text); return text }
  /<testcase / {
    tests++; counted = 0
    skipped_now = /status="notrun"/ || /status="disabled"/
    if (skipped_now) skipped++
    failed_now = /status="fail"/
    if (failed_now) {
      failed++; quoted = 0
      name = $0; sub(/.*<testcase name="/, "", name); sub(/".*/, "", name)
      failures = failures "  failed: " unescape(name) "\n"
    }
  }
  # The first lines of a failing test that name an assertion, an exception or the report of a sanitizer, with the two lines after each.
  failed_now && quoted < 12 && (/: Failure$/ || /ERROR: / || /WARNING: ThreadSanitizer/ || /runtime error: / || /what\(\)/) { following = 4 }
  failed_now && following > 0 && quoted < 12 { failures = failures "      " unescape($0) "\n"; following--; quoted++ }
  skipped_now && !counted && /no test data: / {
    file = $0; sub(/.*no test data: /, "", file); sub(/ \(set EARSHOT_DATA\).*/, "", file)
    absent[unescape(file)]++; data++; counted = 1
  }
  END {
    sort = "sort -rn"
    for (file in absent) printf "  %4d skipped without %s\n", absent[file], file | sort
    close(sort)
    printf "%s", failures
    line = sprintf("%d tests, %d failed, %d skipped for want of data", tests, failed, data)
    if (data > 0) line = line " (EARSHOT_DATA names their folder)"
    if (skipped > data) line = line sprintf(", %d skipped for another reason", skipped - data)
    print line
  }'
