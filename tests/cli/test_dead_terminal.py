"""A terminal that was closed, a pipe whose reader has gone: standard error is no reason to lose a run."""

from __future__ import annotations

import errno
import signal
import sys
from collections.abc import Callable
from unittest import mock

import pytest

from tracker.training.progress import Progress
from uavfollow import cli
from uavfollow.__main__ import main
from uavfollow.errors import EXIT_BAD_INPUT, EXIT_INTERRUPTED, InputError
from uavfollow.progress import ProgressLine
from uavfollow.tell import tell
from uavfollow.training.progress import TrainProgress
from uavfollow.training.stop import stop_on_signal

FAULTS: dict[str, Callable[[], Exception]] = {
    "terminal closed": lambda: OSError(errno.EIO, "Input/output error"),
    "pipe broken": BrokenPipeError,
    "file closed": lambda: ValueError("I/O operation on closed file"),
}


class Dead:
    """Whatever is written fails; counts the tries."""

    def __init__(self, fault: Callable[[], Exception]) -> None:
        self.fault, self.tries = fault, 0

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        self.tries += 1
        raise self.fault()

    def flush(self) -> None:
        raise self.fault()

    def close(self) -> None:
        raise self.fault()


@pytest.fixture(params=FAULTS)
def dead(request: pytest.FixtureRequest) -> Dead:
    return Dead(FAULTS[request.param])


def _on(stderr: Dead | None):  # type: ignore[no-untyped-def]
    """Not by a fixture: pytest puts its own in place before each test's body."""
    return mock.patch.object(sys, "stderr", stderr)


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTERM, signal.SIGINT])
def test_a_signal_is_a_wish_all_the_same(dead: Dead, number: int) -> None:
    with _on(dead), stop_on_signal() as stop:
        signal.raise_signal(number)
        asked = stop()
    assert (asked, dead.tries) == (True, 1)


def test_a_signal_in_the_middle_of_a_line() -> None:
    busy = Dead(lambda: RuntimeError("reentrant call inside BufferedWriter"))
    with _on(busy), stop_on_signal() as stop:
        signal.raise_signal(signal.SIGTERM)
        asked = stop()
    assert asked


def test_the_progress_line_becomes_quiet(dead: Dead) -> None:
    with _on(dead):
        line = ProgressLine()
        line.write("half way")
        line.write("further")
        line.close()
        due_s = line.due_s()
        assert dead.tries == 1
        progress = TrainProgress()
        for note in ("validating", "again"):
            progress.show(Progress(1, 1, 2, 4, None, {}, 1e-3, None, note))
        progress.close()
    assert (due_s, dead.tries) == (None, 2)


def test_the_line_dies_while_it_is_open(capsys: pytest.CaptureFixture[str]) -> None:
    line = ProgressLine()
    line._terminal = True
    line.write("half way")
    assert capsys.readouterr().err == "\r\033[Khalf way"
    with _on(Dead(BrokenPipeError)):
        line.close()
        line.close()
    line.write("alive again")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("raised", "code"),
    [
        (InputError("nothing to read"), EXIT_BAD_INPUT),
        (OSError(errno.ENOSPC, "No space left"), EXIT_BAD_INPUT),
        (KeyboardInterrupt(), EXIT_INTERRUPTED),
        (BrokenPipeError(), EXIT_INTERRUPTED),
    ],
)
def test_errors_keep_their_exit_code(dead: Dead, monkeypatch: pytest.MonkeyPatch, raised, code: int) -> None:
    monkeypatch.setattr(cli, "run", mock.Mock(side_effect=raised))
    with _on(dead):
        got = main([])
    assert got == code


def test_what_another_process_tells_is_not_told_twice(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "run", mock.Mock(side_effect=InputError("")))
    assert main([]) == EXIT_BAD_INPUT
    assert capsys.readouterr() == ("", "")


def test_without_standard_error_nothing_goes_to_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    with _on(None):
        tell("lost")
        ProgressLine().close()
    assert capsys.readouterr().out == ""
