"""Entry point of the `uavfollow` command and of `python -m uavfollow`."""

from __future__ import annotations

import sys

from uavfollow.errors import EXIT_BAD_INPUT, EXIT_INTERRUPTED, InputError
from uavfollow.packages import check_packages
from uavfollow.tell import tell


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns its exit code. Bad input is one line on standard error and exit code 2."""
    try:
        check_packages()
        from uavfollow.cli import run  # only now: it imports the packages that were just checked

        return run(sys.argv[1:] if argv is None else argv)
    except InputError as error:
        if str(error):  # else another process of the same run has told it
            tell(f"uavfollow: error: {error}")
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        tell("uavfollow: interrupted")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of our output (head, less) has gone; that is its right and no fault.
        _close_stderr()
        return EXIT_INTERRUPTED
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        tell(f"uavfollow: error: {where}{error.strerror or error}")
        return EXIT_BAD_INPUT


def _close_stderr() -> None:
    """Python would complain there of the broken pipe at its end."""
    try:
        if sys.stderr is not None:
            sys.stderr.close()
    except (OSError, ValueError):
        pass


if __name__ == "__main__":
    sys.exit(main())
