#!/usr/bin/env bash
# scripts/summarize_tests.sh JUNIT.xml...
# Sums up what ctest --output-junit wrote (one file per preset): which test data were absent and how many tests each file cost, then one line:
# tests, failures, skips.  A test that ran under several presets counts once for each.
set -euo pipefail

cat "$@" | awk '
  function unescape(text) { gsub(/&lt;/, "<", text); gsub(/&gt;/, ">", text); gsub(/&quot;/, "\"", text); gsub(/&amp;/, "\\&", text); return text }
  /<testcase / {
    tests++; counted = 0
    skipped_now = /status="notrun"/ || /status="disabled"/
    if (skipped_now) skipped++
    if (/status="fail"/) failed++
  }
  skipped_now && !counted && /no test data: / {
    file = $0; sub(/.*no test data: /, "", file); sub(/ \(set EARSHOT_DATA\).*/, "", file)
    absent[unescape(file)]++; data++; counted = 1
  }
  END {
    sort = "sort -rn"
    for (file in absent) printf "  %4d skipped without %s\n", absent[file], file | sort
    close(sort)
    line = sprintf("%d tests, %d failed, %d skipped for want of data", tests, failed, data)
    if (data > 0) line = line " (EARSHOT_DATA names their folder)"
    if (skipped > data) line = line sprintf(", %d skipped for another reason", skipped - data)
    print line
  }'
