"""Choosing the target of `uavfollow track`: a click, a list to pick from, and what is refused."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uavfollow.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tracker.box import Box
    from tracker.messages import Frame, ImageU8
    from tracker.selection import Proposal, Scorer
    from uavfollow.record.summary import TrackSummary
    from uavfollow.video.source import FrameSource

MakeScorer = Callable[[], "Scorer"]  # only when a click is to be judged: it loads the network
SUMMARY_NAME = "summary.json"
PROPOSALS_NAME = "first_frame_proposals.png"
LOOK_S = 1.0  # of the material's beginning is looked at for what moves
MOST_LOOKED_AT = 60  # frames
KINDS = ("person", "vehicle", "boat", "static")  # the values of tracker.presets.TargetKind, without importing it


@dataclass(frozen=True, slots=True)
class Choice:
    """A box to be tracked; what the run's summary says of how it was chosen; lines for the user."""

    box: Box
    record: dict[str, str | float | bool | None]
    notes: tuple[str, ...] = ()


def add_options(parser: Any) -> None:
    """The options that choose a target, for a subparser: a group of its own in the help."""
    group = parser.add_argument_group("choosing the target", "by --box (above) or by one of these, in the first frame")
    group.add_argument("--click", metavar="X,Y", help="a point on the target, px; gives the box")
    group.add_argument(
        "--targets", action="store_true",
        help="list and draw numbered boxes to pick from (of --click, or of all), and track none",
    )  # fmt: skip
    group.add_argument("--pick", metavar="N", type=int, help="take number N of the boxes (default with --click: 1)")
    group.add_argument("--force", action="store_true", help="track even a box that is unsuitable as a target")
    group.add_argument("--preset", choices=KINDS, help="what the target is: sets filter noise and coasting")


def check_options(arguments: argparse.Namespace, raw: bool) -> None:
    """Raise InputError on options that contradict each other. `raw`: there is no filter for a preset to set."""
    if arguments.preset is not None and raw:
        raise InputError("--preset sets the filter, and a raw tracker has none; leave --preset or the raw tracker out")
    if arguments.click is not None and arguments.box is not None:
        raise InputError("--click and --box both give the target; leave one out")
    if arguments.targets and arguments.box is not None:
        raise InputError("--targets proposes boxes and --box gives one; leave one out")
    if arguments.pick is not None and arguments.click is None and not arguments.targets:
        raise InputError("--pick chooses among the boxes of --click X,Y or --targets; give one of them too")
    if arguments.pick is not None and arguments.pick < 1:
        raise InputError(f"--pick {arguments.pick}: boxes are numbered from 1")


def is_wanted(arguments: argparse.Namespace) -> bool:
    """Whether the target is to be chosen by what this module does."""
    return arguments.click is not None or bool(arguments.targets)


def option_name(arguments: argparse.Namespace) -> str:
    """What an error about the chosen box names."""
    pick = f" --pick {arguments.pick}" if arguments.pick is not None else ""
    return (f"--click {arguments.click}" if arguments.click is not None else "--targets") + pick


def lists_only(arguments: argparse.Namespace) -> bool:
    """Whether only the list was asked for."""
    return bool(arguments.targets) and arguments.pick is None


def parse_click(text: str) -> tuple[float, float]:
    """`X,Y` in px. Raises InputError."""
    parts = text.replace(" ", "").split(",")
    try:
        values = [float(p) for p in parts]
    except ValueError:
        values = []
    if len(values) != 2 or not all(math.isfinite(v) for v in values):
        raise InputError(f"--click {text!r} is not X,Y: two finite numbers with a comma, for example --click 320,180")
    return values[0], values[1]


def choose(arguments: argparse.Namespace, source: FrameSource, make_scorer: MakeScorer) -> Choice:
    """The box that `--click` or `--targets`, with `--pick`, mean. Raises InputError when there is none."""
    from tracker.selection import unsuitable, warning

    frames = _looked_at(arguments, source)
    proposals = _proposals(arguments, frames, make_scorer)
    image = frames[0].image_bgr_u8
    number = arguments.pick
    if number is None:  # the best of those that can be tracked
        fit = (k for k, p in enumerate(proposals, 1) if arguments.force or unsuitable(image, p.box) is None)
        number = next(fit, 1)
    if number > len(proposals):
        raise InputError(f"--pick {number}: there are {len(proposals)} boxes; look at them with --targets")
    taken = proposals[number - 1]
    scores = ", ".join(f"{p.score:.2f}" for p in proposals)
    again = _again(arguments)
    notes = [
        f"took box {number} of {len(proposals)} ({taken.reason.value}; scores {scores}); "
        f"--pick K takes another, {again if again == '--targets' else again + ' --targets'} shows them"
    ]
    poor = warning(image, taken.box)
    if poor is not None:
        notes.append(f"warning: {poor}")
    record: dict[str, str | float | bool | None] = {
        "click": arguments.click,
        "pick": number,
        "targets": "; ".join(_line(k, p, image) for k, p in enumerate(proposals, 1)),
    }
    return Choice(taken.box, record, tuple(notes))


def forced(arguments: argparse.Namespace, box: Box, source: FrameSource) -> dict[str, str | float | bool | None]:
    """What the summary says of `--force`: the refusal that it overrode, or that it overrode none."""
    from tracker.selection import unsuitable

    if not arguments.force:
        return {}
    if source.count is None:  # a camera's first picture comes but once
        return {"forced": "not known"}
    refusal = unsuitable(_first_frames(source, 1)[0].image_bgr_u8, box)
    return {"forced": refusal.value if refusal is not None else "nothing to override"}


def write_targets(arguments: argparse.Namespace, source: FrameSource, out: Path, make_scorer: MakeScorer) -> str:
    """Write the picture of numbered boxes; returns what to tell the user. Raises InputError when there are none."""
    from uavfollow.record.output import OutputFolder
    from uavfollow.video.proposals import draw_proposals
    from uavfollow.video.writer import write_image

    frames = _looked_at(arguments, source)
    proposals = _proposals(arguments, frames, make_scorer)
    image = frames[0].image_bgr_u8
    folder = OutputFolder(out)
    try:
        write_image(folder.path(PROPOSALS_NAME), draw_proposals(image, proposals))
        place = folder.commit()[0]
    except BaseException:
        folder.abort()
        raise
    if arguments.json:
        targets = [_as_json(k, p, image) for k, p in enumerate(proposals, 1)]
        return json.dumps({"click": arguments.click, "targets": targets, "files": [str(place)]}, indent=1)
    lines = [_line(k, p, image) for k, p in enumerate(proposals, 1)]
    return "\n".join([*lines, f"look at {place}, then track number N with {_again(arguments)} --pick N"])


def record(summary: TrackSummary, chosen: dict[str, str | float | bool | None]) -> TrackSummary:
    """The summary with how the target was chosen among its settings, also in the run's summary.json."""
    if not chosen:
        return summary
    told = replace(summary, settings={**summary.settings, **chosen})
    place = next((Path(f) for f in summary.files if Path(f).name == SUMMARY_NAME), None)
    if place is not None:
        fresh = place.with_name(f".{SUMMARY_NAME}.partial")
        try:
            fresh.write_text(told.json() + "\n")
            fresh.replace(place)
        except OSError as error:
            raise InputError(
                f"--out {place.parent}: {SUMMARY_NAME}: {error.strerror or error}; free some space"
            ) from error
    return told


def _again(arguments: argparse.Namespace) -> str:
    return f"--click {arguments.click}" if arguments.click is not None else "--targets"


def _looked_at(arguments: argparse.Namespace, source: FrameSource) -> list[Frame]:
    return _first_frames(source, 1 if arguments.click is not None else MOST_LOOKED_AT)


def _first_frames(source: FrameSource, at_most: int) -> list[Frame]:
    if source.count is None:
        raise InputError(
            "--click and --targets look at recorded material; for a camera give the box with --box X,Y,W,H"
        )
    count = min(at_most, max(2, round(LOOK_S * source.fps))) if at_most > 1 else 1
    frames = list(islice(source.frames(), count))
    if not frames or frames[0] is None:
        raise InputError("the first frame cannot be read")
    return [f for f in frames if f is not None and f.image_bgr_u8.shape == frames[0].image_bgr_u8.shape]


def _proposals(arguments: argparse.Namespace, frames: list[Frame], make_scorer: MakeScorer) -> list[Proposal]:
    if arguments.click is not None:
        return _of_click(arguments.click, frames[0].image_bgr_u8, make_scorer)
    found = _of_all(frames)
    if not found:
        raise InputError("nothing in the first second moves or stands out; give a point with --click X,Y")
    return found


def _of_click(text: str, image: ImageU8, make_scorer: MakeScorer) -> list[Proposal]:
    from tracker.selection import propose

    point = parse_click(text)
    height, width = image.shape[:2]
    if not (0 <= point[0] < width and 0 <= point[1] < height):
        raise InputError(f"--click {text}: lies outside of the frame of {width} x {height} px")
    found = list(propose(image, point, make_scorer()))
    if not found:
        raise InputError(f"--click {text}: the frame of {width} x {height} px is too small to hold a target")
    return found


def _of_all(frames: Sequence[Frame]) -> list[Proposal]:
    """What moves, then what stands out. The frames are looked at backwards: so the boxes are those of the first one."""
    from tracker.selection import MotionProposals, salient, unsuitable
    from tracker.selection.ranking import MAX_LISTED, holds

    motion, last_s = MotionProposals(), frames[-1].t_capture_s
    moving: Sequence[Proposal] = ()
    for frame in reversed(frames):
        moving = motion.step(frame.image_bgr_u8, last_s - frame.t_capture_s)
    image = frames[0].image_bgr_u8
    movers = [p for p in moving if unsuitable(image, p.box) is None]
    others = [p for p in salient(image) if not any(holds(m.box, p.box) for m in movers)]
    return [*movers, *others][:MAX_LISTED]


def _line(number: int, proposal: Proposal, image: ImageU8) -> str:
    from tracker.selection import unsuitable

    reason = unsuitable(image, proposal.box)
    unfit = f"  unsuitable: {reason.value}" if reason is not None else ""
    return f"{number}  {_xywh(proposal)}  {proposal.reason.value}  {proposal.score:.2f}{unfit}"


def _as_json(number: int, proposal: Proposal, image: ImageU8) -> dict[str, str | float | None]:
    from tracker.selection import unsuitable

    refusal = unsuitable(image, proposal.box)
    return {
        "number": number,
        "box": _xywh(proposal),
        "reason": proposal.reason.value,
        "score": round(proposal.score, 3),
        "unsuitable": refusal.value if refusal is not None else None,
    }


def _xywh(proposal: Proposal) -> str:
    return ",".join(f"{v:.1f}" for v in proposal.box.to_xywh())
