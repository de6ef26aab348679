"""`uavfollow sitl`: the simulator by itself: its scenarios, and its autopilot for any MAVLink program."""

from __future__ import annotations

import argparse
import difflib
import sys
import time
from typing import Any

from uavfollow.errors import EXIT_DONE, InputError
from uavfollow.interrupts import orderly_end

NAME = "sitl"
STEP_S = 0.005  # 200 Hz: an answer is at most so late
REPORT_PERIOD_S = 5.0
MAX_LAG_S = 1.0  # a machine that fell behind further goes on from there instead of hurrying after


def add_parser(commands: Any) -> Any:
    """Add the command and its own commands to the subparsers; returns its parser."""
    parser = commands.add_parser(NAME, help="scenarios of the simulator; the simulated autopilot by itself")
    own = parser.add_subparsers(dest="sitl_command", metavar="COMMAND", required=True)
    listed = own.add_parser("list", help="names of the built-in scenarios")
    listed.set_defaults(run=_list)
    show = own.add_parser("show", help="print a built-in scenario, to copy and change")
    show.add_argument("scenario", metavar="SCENARIO")
    show.set_defaults(run=_show)
    autopilot = own.add_parser(
        "autopilot",
        help="a simulated ArduCopter in real time, for companions and MAVLink programs",
        description="A simulated ArduCopter in real time. It has no missions and none of the old data streams, so a "
        "ground station shows less than of a real one.",
    )
    autopilot.add_argument(
        "--link", metavar="ADDRESS", action="append", required=True,
        help="udpout:HOST:PORT, udpin:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or serial:DEVICE,BAUD; may be repeated",
    )  # fmt: skip
    autopilot.add_argument("--seed", type=int, default=0, help="of wind and noise")
    autopilot.add_argument("--scenario", default="default", help="whose vehicle, gimbal and wind (default: default)")
    autopilot.add_argument("--for-s", type=float, help="end after so many seconds (default: at Ctrl-C)")
    autopilot.set_defaults(run=_autopilot)
    return parser


def _list(arguments: argparse.Namespace) -> int:
    from sitl.scenario import builtin_names, load_scenario

    for name in builtin_names():
        scenario = load_scenario(name)
        pending = "; pending: " + "; ".join(scenario.pending_reasons()) if scenario.pending_reasons() else ""
        print(f"{name:16} {scenario.duration_s:g} s  {scenario.description.strip()}{pending}")
    return EXIT_DONE


def _show(arguments: argparse.Namespace) -> int:
    from importlib import resources

    from sitl.scenario import builtin_names

    names = builtin_names()
    if arguments.scenario not in names:
        close = difflib.get_close_matches(arguments.scenario, names, 1)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise InputError(f"scenario {arguments.scenario}: not built in{hint} (built in: {', '.join(names)})")
    print((resources.files("sitl") / "scenarios" / f"{arguments.scenario}.yaml").read_text("utf-8"), end="")
    return EXIT_DONE


def _autopilot(arguments: argparse.Namespace) -> int:
    if arguments.for_s is not None and not 0 < arguments.for_s < 1e9:
        raise InputError(f"--for-s {arguments.for_s}: give a number of seconds above 0")
    if not 0 <= arguments.seed < 2**32:
        raise InputError(f"--seed {arguments.seed} is out of range, must lie in 0..{2**32 - 1}")
    from uavfollow.mavlink.link import AddressError, LinkError

    flight = _flight(arguments.scenario, arguments.seed)
    links: list[Any] = []
    try:
        for text in arguments.link:
            links.append(_open(text))
            flight.autopilot.attach(links[-1], text)
        with orderly_end():
            _serve(flight, arguments.link, arguments.for_s)
    except (AddressError, LinkError) as error:
        raise InputError(f"--link: {error}") from error
    except KeyboardInterrupt:
        print("ended", file=sys.stderr)  # the way this command ends
    finally:
        for link in links:
            link.close()
    return EXIT_DONE


def _flight(name: str, seed: int) -> Any:
    """Vehicle, gimbal and autopilot of a scenario. Raises InputError."""
    from sitl.flight import Flight, build_world
    from sitl.scenario import ScenarioError, drawn, load_scenario

    try:
        scenario = load_scenario(name)
        if scenario.pending_reasons():
            raise InputError(f"scenario {scenario.name} is pending: {'; '.join(scenario.pending_reasons())}")
        scenario = drawn(scenario, seed)
        return Flight(scenario, seed, build_world(scenario, seed))
    except ScenarioError as error:
        raise InputError(f"scenario {error}") from error
    except ValueError as error:  # what the seed draws cannot be
        raise InputError(f"scenario {name}, seed {seed}: {error}") from error


def _open(text: str) -> Any:
    from uavfollow.mavlink.link import LinkKind, open_link, parse_address

    address = parse_address(text)
    if address.kind is LinkKind.TLOG:
        raise InputError(f"--link {text}: a tlog is no link; give udpout:, udpin:, tcp:, tcpin: or serial:")
    return open_link(address, must_connect=False)


def _serve(flight: Any, names: list[str], for_s: float | None) -> None:
    """Step the autopilot with the wall clock until `for_s` or an interruption."""
    print(f"simulated ArduCopter on {', '.join(names)}; Ctrl-C ends it", file=sys.stderr)
    start_s, shown_s, now_s = time.monotonic(), 0.0, 0.0
    while for_s is None or now_s < for_s:
        passed_s = time.monotonic() - start_s - now_s
        if passed_s > MAX_LAG_S:
            print(f"{passed_s:.1f} s were lost: the computer slept or is too slow just now", file=sys.stderr)
            start_s += passed_s
        now_s = max(time.monotonic() - start_s, now_s)
        flight.autopilot.step(now_s)
        if now_s - shown_s >= REPORT_PERIOD_S:
            shown_s = now_s
            state = flight.autopilot.state
            north, east, down = flight.vehicle.pos_ned_m
            print(
                f"{now_s:6.0f} s  {state.mode.name}  {'armed' if state.armed else 'disarmed'}  "
                f"north {north:.1f} east {east:.1f} height {-down:.1f} m",
                file=sys.stderr,
            )
        time.sleep(STEP_S)
