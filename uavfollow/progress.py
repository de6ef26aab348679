"""A progress line on standard error: rewritten in place on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time

from tracker.messages import TargetState

TERMINAL_PERIOD_S = 0.2
LOG_PERIOD_S = 10.0


class Progress:
    """Shows frame number, rate, status and remaining time."""

    def __init__(self, count: int | None) -> None:
        self._count = count
        self._quiet = sys.stderr is None  # closed by the shell (2>&-)
        self._terminal = not self._quiet and sys.stderr.isatty()
        self._start_s = self._shown_s = time.monotonic()
        self._open = False

    def show(self, done: int, target: TargetState) -> None:
        """Say how far it is, when it is time to."""
        now_s = time.monotonic()
        if self._quiet or now_s - self._shown_s < (TERMINAL_PERIOD_S if self._terminal else LOG_PERIOD_S):
            return
        self._shown_s = now_s
        rate = done / max(now_s - self._start_s, 1e-9)
        total = f"/{self._count}  {(self._count - done) / max(rate, 1e-9):.0f} s left" if self._count else ""
        line = f"frame {done}{total}  {rate:.1f} fps  {target.status.value} {target.confidence:.2f}"
        print(f"\r\033[K{line}" if self._terminal else line, end="" if self._terminal else "\n", file=sys.stderr)
        sys.stderr.flush()
        self._open = self._terminal

    def close(self) -> None:
        """Clear the line."""
        if self._open:
            print("\r\033[K", end="", file=sys.stderr)
            sys.stderr.flush()
            self._open = False
