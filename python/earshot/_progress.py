# SPDX-License-Identifier: Apache-2.0
"""A line of progress as the program prints it."""

from __future__ import annotations

import sys
import time


class Progress:
    """One line on stderr with the rate and the time to go: redrawn on a terminal, else printed every 30 s and at the end."""

    def __init__(self, label: str, unit: str, total: int, *, shown: bool = True, every_s: float = 30.0) -> None:
        self.label, self.unit, self.total, self.shown = label, unit, total, shown
        self.terminal = sys.stderr.isatty()
        self.every_s = 0.1 if self.terminal else every_s
        self.begin = self.drawn = time.monotonic()
        self.is_drawn = False

    def update(self, done: int, note: str = "") -> None:
        """:param done: Units finished so far."""
        now = time.monotonic()
        if not self.shown or (now - self.drawn < self.every_s and done < self.total):
            return
        self.drawn, self.is_drawn = now, True
        line = self.line(done, now - self.begin, note)
        print(f"\r\033[K{line}" if self.terminal else line, end="" if self.terminal else "\n", file=sys.stderr, flush=True)

    def line(self, done: int, elapsed_s: float, note: str = "") -> str:
        rate = done / elapsed_s if elapsed_s > 0 else 0.0
        left_s = (self.total - done) / rate if rate > 0 else 0.0
        percent = 100.0 * done / self.total if self.total else 100.0
        text = f"{self.label}  {percent:.0f} %  {done}/{self.total} {self.unit}  {rate:.3g} {self.unit}/s  {left_s:.0f} s to go"
        return f"{text}  {note}" if note else text

    def close(self) -> None:
        if self.is_drawn and self.terminal:
            print(file=sys.stderr)
