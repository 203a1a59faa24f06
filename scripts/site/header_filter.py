#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""header_filter.py HEADER: prints a header as Doxygen shall read it: what is said before its namespace is said of the file.

Doxygen would put the comment before `namespace earshot` on the page of every header, as one namespace has them all.  The lines keep their numbers.
"""

import pathlib
import re
import sys


def filtered(text: str) -> str:
    lines = text.splitlines()
    is_first = True
    for i, line in enumerate(lines):
        if not re.match(r"\s*namespace\b", line):
            continue
        begin = i
        while begin > 0 and lines[begin - 1].lstrip().startswith("///"):
            begin -= 1
        if begin == i:
            continue
        if is_first and begin > 0 and not lines[begin - 1].strip():
            lines[begin - 1] = "/// \\file"
        else:
            lines[begin:i] = [comment.replace("///", "//", 1) for comment in lines[begin:i]]
        is_first = False
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(filtered(pathlib.Path(sys.argv[1]).read_text(encoding="utf-8")))
