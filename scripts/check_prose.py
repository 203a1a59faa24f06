#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures how the documentation reads: words, long sentences, long lines.

check_prose.py [--report] [FILE...]   (default: README.md and every page of docs/ but the generated ones of docs/figures)

Fails if a line is longer than 100 columns (tables, code and addresses apart), or if more than 3 % of the sentences of README.md and of the
guide pages (all of docs/ but docs/evidence) have over 30 words.  --report prints the figures of each page and always succeeds.
"""

import pathlib
import re
import subprocess
import sys

MAX_COLUMNS = 100
MAX_WORDS_OF_SENTENCE = 30
MAX_FRACTION_OF_LONG = 0.03


def prose_of(text):
    """Paragraphs, list items and headings of a page: no code, tables, pictures, comments or addresses."""
    text = re.sub(r"^(```|~~~).*?^\1[ \t]*$", "", text, flags=re.S | re.M)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.S)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    blocks, block = [], []
    for line in text.splitlines() + [""]:
        if re.match(r"\s*\|", line):
            line = ""
        starts = re.match(r"\s*([-*+]|\d+\.)\s|#", line)
        if (not line.strip() or starts) and block:
            blocks.append(" ".join(block))
            block = []
        if line.strip():
            block.append(re.sub(r"^\s*([-*+]|\d+\.|#+)\s+", "", line).strip())
    return blocks


def sentences_of(text):
    """Sentences, each code span counted as one word."""
    found = []
    for block in prose_of(text):
        block = re.sub(r"`+[^`]*`+", "CODE", block)
        found += [s for s in re.split(r"(?<=[.!?])\s+(?=[A-Z(\"*_0-9])|;\s+|:\s+(?=[A-Z])", block) if re.search(r"\w", s)]
    return found


def num_words(sentence):
    return len(re.findall(r"\b[\w'’./%-]+", sentence))


def long_lines(text):
    found, fenced = [], False
    for number, line in enumerate(text.splitlines(), 1):
        if re.match(r"\s*(```|~~~)", line):
            fenced = not fenced
        is_exempt = fenced or re.match(r"\s*\|", line) or re.search(r"https?://|\]\(|\]:", line)
        if len(line) > MAX_COLUMNS and not is_exempt:
            found.append((number, len(line)))
    return found


def main(arguments):
    report = "--report" in arguments
    paths = [a for a in arguments if a != "--report"]
    if not paths:
        paths = subprocess.run(["git", "ls-files", "README.md", "docs/*.md", ":!docs/figures"], check=True, capture_output=True, text=True).stdout.split()
    failed = False
    num_guide = num_guide_long = total_words = 0
    for path in paths:
        text = pathlib.Path(path).read_text(encoding="utf-8")
        sentences = sentences_of(text)
        words = [num_words(s) for s in sentences]
        too_long = sum(count > MAX_WORDS_OF_SENTENCE for count in words)
        lines = long_lines(text)
        total_words += len(text.split())
        if "evidence/" not in path:
            num_guide += len(sentences)
            num_guide_long += too_long
        if report:
            print(f"{path:45} {len(text.split()):6} words {len(text.splitlines()):5} lines {len(sentences):5} sentences"
                  f" {too_long:4} over {MAX_WORDS_OF_SENTENCE} words {len(lines):4} lines over {MAX_COLUMNS} columns")
        else:
            for number, columns in lines:
                print(f"{path}:{number}: {columns} columns; wrap at {MAX_COLUMNS}")
                failed = True
    fraction = num_guide_long / max(num_guide, 1)
    print(f"prose: {total_words} words, {num_guide_long} of {num_guide} sentences outside evidence ({100 * fraction:.1f} %) over"
          f" {MAX_WORDS_OF_SENTENCE} words")
    if fraction > MAX_FRACTION_OF_LONG and not report:
        print(f"prose: at most {100 * MAX_FRACTION_OF_LONG:.0f} % may be so long; --report names the pages")
        failed = True
    return 0 if report else int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
