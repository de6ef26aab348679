"""Entry point of the `uavfollow` command and of `python -m uavfollow`."""

from __future__ import annotations

import sys

from uavfollow.errors import EXIT_BAD_INPUT, EXIT_INTERRUPTED, InputError
from uavfollow.packages import check_packages


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns its exit code. Bad input is one line on standard error and exit code 2."""
    try:
        check_packages()
        from uavfollow.cli import run  # only now: it imports the packages that were just checked

        return run(sys.argv[1:] if argv is None else argv)
    except InputError as error:
        print(f"uavfollow: error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("uavfollow: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of our output (head, less) has gone; that is its right and no fault.
        sys.stderr.close()
        return EXIT_INTERRUPTED
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"uavfollow: error: {where}{error.strerror or error}", file=sys.stderr)
        return EXIT_BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
