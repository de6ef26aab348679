"""Signals as a wish: training finishes its step, saves and ends."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from uavfollow.interrupts import ENDING
from uavfollow.tell import tell

STOPPING = "stopping: the step is finished and everything saved; Ctrl-C once more gives up"


class Stop:
    """Whether somebody wants an end."""

    def __init__(self) -> None:
        self.wanted = False

    def __call__(self) -> bool:
        """As what a trainer asks."""
        return self.wanted

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self.wanted and number == signal.SIGINT:
            raise KeyboardInterrupt
        # torchrun passes a SIGTERM on to a process that the terminal has told already: it is the same wish.
        told, self.wanted = self.wanted, True
        if not told:
            tell(f"\n{STOPPING}")


@contextmanager
def stop_on_signal() -> Iterator[Stop]:
    """SIGINT, SIGTERM and SIGHUP set `wanted`; a second SIGINT raises KeyboardInterrupt.

    Outside the main thread, where no handler can be set, nothing sets it.
    """
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = {number: signal.getsignal(number) for number in ENDING}
    try:
        for number in ENDING:
            if before[number] is not signal.SIG_IGN:  # `nohup` has said that it does not matter
                signal.signal(number, stop._ask)
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
