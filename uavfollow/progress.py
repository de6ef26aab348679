"""A progress line on standard error: rewritten in place on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time

from tracker.messages import TargetState

TERMINAL_PERIOD_S = 0.2
LOG_PERIOD_S = 10.0


class ProgressLine:
    """The line itself. Shows nothing when standard error is closed, and no more when it dies (a closed terminal)."""

    def __init__(self) -> None:
        self._quiet = sys.stderr is None  # closed by the shell (2>&-)
        self._terminal = self._is_terminal()
        self._start_s = self._shown_s = time.monotonic()
        self._open = False

    def due_s(self) -> float | None:
        """Seconds since the start when the line is to be shown again, else None."""
        now_s = time.monotonic()
        if self._quiet or now_s - self._shown_s < (TERMINAL_PERIOD_S if self._terminal else LOG_PERIOD_S):
            return None
        self._shown_s = now_s
        return max(now_s - self._start_s, 1e-9)

    def write(self, line: str) -> None:
        """Show the line."""
        self._print(f"\r\033[K{line}" if self._terminal else f"{line}\n")
        self._open = self._terminal

    def close(self) -> None:
        """Clear the line."""
        if self._open:
            self._print("\r\033[K")
            self._open = False

    def _is_terminal(self) -> bool:
        try:
            return not self._quiet and sys.stderr.isatty()
        except ValueError:  # closed by the program around us
            self._quiet = True
            return False

    def _print(self, text: str) -> None:
        if self._quiet:
            return
        try:
            sys.stderr.write(text)
            sys.stderr.flush()
        except (OSError, ValueError):
            self._quiet = True


class Progress:
    """Shows frame number, rate, status and remaining time."""

    def __init__(self, count: int | None) -> None:
        self._count = count
        self._line = ProgressLine()

    def show(self, done: int, target: TargetState) -> None:
        """Say how far it is, when it is time to."""
        spent_s = self._line.due_s()
        if spent_s is None:
            return
        rate = done / spent_s
        total = f"/{self._count}  {(self._count - done) / max(rate, 1e-9):.0f} s left" if self._count else ""
        self._line.write(f"frame {done}{total}  {rate:.1f} fps  {target.status.value} {target.confidence:.2f}")

    def close(self) -> None:
        """Clear the line."""
        self._line.close()


class SimProgress:
    """Shows simulated time, how fast it passes, and the status."""

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s
        self._line = ProgressLine()

    def show(self, scene_s: float, status: str) -> None:
        """Say how far it is, when it is time to."""
        spent_s = self._line.due_s()
        if spent_s is not None:
            factor = scene_s / spent_s
            self._line.write(f"{scene_s:.1f}/{self._duration_s:.0f} s  {factor:.2f} times real time  {status}")

    def close(self) -> None:
        """Clear the line."""
        self._line.close()
