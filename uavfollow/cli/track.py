"""`uavfollow track`: follow a target through recorded material or a camera, and write what was seen and sent."""

from __future__ import annotations

import argparse
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uavfollow.cli import selecting
from uavfollow.errors import EXIT_DONE, EXIT_INTERRUPTED, EXIT_SHORT, InputError
from uavfollow.interrupts import orderly_end
from uavfollow.tell import tell

if TYPE_CHECKING:
    from tracker.box import Box
    from tracker.messages import Frame
    from tracker.selection import Scorer
    from uavfollow.track_run import TrackOptions
    from uavfollow.trackers import TrackerSpec
    from uavfollow.video.source import FrameSource

NAME = "track"
GRID_NAME = "first_frame_grid.png"
FROM_TRUTH = "--truth, first row"
MAX_FAULTY_SHARE = 0.5  # with more of the frames unreadable the run has not done what it was asked for
SPARE_CORES = 1  # left to video, MAVLink and the rest of the companion: spinning threads on all cores collapse
EPILOG = """The setpoints are those for a camera that looks straight forward from a hovering vehicle and does not move:
open loop. Their metres scale with --range-m, the range to the target at selection."""


def add_parser(commands: Any) -> Any:
    """Add the command to the subparsers; returns its parser."""
    parser = commands.add_parser(NAME, help="track a target in a video, an image folder or a camera", epilog=EPILOG)
    parser.add_argument("source", metavar="SOURCE", help="video file, folder of images, or camera index")
    parser.add_argument("--box", metavar="X,Y,W,H", help="target in the first frame, px from the top-left corner")
    parser.add_argument("--model", help="s, full or a .safetensors file (default: s)")
    parser.add_argument(
        "--tracker", metavar="SPEC", default="siamapnpp",
        help="NAME[@MODEL][+raw]: siamapnpp, nanotrack@FOLDER with its two ONNX files, or a plug-in's name",
    )  # fmt: skip
    parser.add_argument("--truth", metavar="FILE", type=Path, help="x,y,w,h per frame; gives scores (and the box)")
    parser.add_argument("--fps", type=float, help="frame rate; of an image folder (default 30), else overrides")
    parser.add_argument("--out", metavar="DIR", type=Path, help="output folder (default: runs/track-NAME)")
    parser.add_argument("--gimbal-mavlink", metavar="OUT.tlog", help="where the setpoints go instead of DIR")
    parser.add_argument("--hfov-deg", type=float, default=66.0, help="horizontal field of view (default: 66)")
    parser.add_argument("--range-m", type=float, default=20.0, help="assumed range at selection (default: 20)")
    parser.add_argument("--max-frames", type=int, help="stop after so many frames")
    parser.add_argument("--raw", action="store_true", help="the tracker alone: no filter, LOCKED on whatever it finds")
    parser.add_argument("--precision", choices=["auto", "fp32", "bf16"], default="auto")
    parser.add_argument("--device", choices=["auto", "cpu", "cuda"], default="auto")
    parser.add_argument("--threads", type=int, help="threads of the network (default: cores less one)")
    parser.add_argument("--no-video", action="store_true", help="write no overlay video")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    selecting.add_options(parser)
    parser.set_defaults(run=_run)
    return parser


def parse_box(text: str) -> Box:
    """`X,Y,W,H` in px. Raises InputError."""
    from tracker.box import Box

    parts = text.replace(" ", "").split(",")
    try:
        values = [float(p) for p in parts]
    except ValueError:
        values = []
    if len(values) != 4 or len(parts) != 4:
        raise InputError(f"--box {text!r} is not X,Y,W,H: four numbers with commas, for example --box 120,80,40,30")
    if not all(math.isfinite(v) for v in values):
        raise InputError(f"--box {text!r} has a value that is not a finite number")
    return Box.from_xywh(*values)


def parse_tlog(text: str) -> Path:
    """The file of a tlog address. Raises InputError, also for a link: what is open loop must reach no vehicle."""
    from uavfollow.mavlink.address import AddressError, LinkKind, parse_address

    if ":" not in text and not text.endswith(".tlog"):
        raise InputError(f"--gimbal-mavlink {text}: is not the name of a tlog; let it end in .tlog")
    try:
        address = parse_address(text)
    except AddressError as error:
        raise InputError(f"--gimbal-mavlink: {error}; here a file is wanted, OUT.tlog") from error
    if address.kind is not LinkKind.TLOG:
        raise InputError(
            f"--gimbal-mavlink {text}: these setpoints are open loop and are sent to no vehicle; give a file, OUT.tlog"
        )
    path = Path(address.path)
    if not path.parent.is_dir():
        raise InputError(f"--gimbal-mavlink {text}: there is no folder {path.parent}; make it first")
    return path


def _check_places(arguments: argparse.Namespace, out: Path) -> None:
    """Nothing that is read may be written over, and no output may become a picture of the source."""
    from uavfollow.record.output import RUN_FILES

    source = Path(arguments.source)
    if source.is_dir() and out.exists() and any(out.samefile(p) for p in (source, source / "img") if p.is_dir()):
        raise InputError(f"--out {out}: is the folder of the images; choose another")
    for given in (arguments.source, arguments.truth, arguments.model):
        for name in (*RUN_FILES, GRID_NAME, selecting.PROPOSALS_NAME):
            if given is not None and (out / name).is_file() and Path(given).exists() and (out / name).samefile(given):
                raise InputError(f"--out {out}: {given} lies there under a name that would be written; choose another")


def _check_numbers(arguments: argparse.Namespace) -> None:
    for option, value, low, high in (
        ("--hfov-deg", arguments.hfov_deg, 1.0, 170.0),
        ("--range-m", arguments.range_m, 1.0, 500.0),
        ("--threads", arguments.threads, 1, 256),
        ("--max-frames", arguments.max_frames, 2, 10**9),
    ):
        if value is not None and not low <= value <= high:
            raise InputError(f"{option} {value} is out of range, must lie in {low}..{high}")


def _run(arguments: argparse.Namespace) -> int:
    _check_numbers(arguments)
    selecting.check_options(arguments, _tracker(arguments).raw)
    tlog = parse_tlog(arguments.gimbal_mavlink) if arguments.gimbal_mavlink is not None else None
    from uavfollow.record.output import free_folder
    from uavfollow.record.truth import check_length, read_truth
    from uavfollow.video.source import open_source

    source = open_source(arguments.source, arguments.fps)
    truth = read_truth(arguments.truth) if arguments.truth else None
    if truth is not None and arguments.truth and source.count is not None:
        check_length(arguments.truth, truth, source.count)
    if truth is not None and source.count is None:
        raise InputError("--truth goes with recorded material, not with a camera")
    out = arguments.out or free_folder(f"track-{source.name}", "report.html")
    _check_places(arguments, out)
    if selecting.lists_only(arguments):
        print(selecting.write_targets(arguments, source, out, lambda: _scorer(arguments)))
        return EXIT_DONE
    chosen = _chosen(arguments, truth, source, out)
    from uavfollow.track_run import run_track

    options = _options(arguments, out, tlog)
    with orderly_end():
        summary = run_track(source, chosen.box, truth, options)
    told = selecting.record(summary, {**chosen.record, **selecting.forced(arguments, chosen.box, source)})
    (told if arguments.json else summary).show(as_json=arguments.json)  # the text has named the box before the run
    if summary.interrupted:
        return EXIT_INTERRUPTED
    return EXIT_SHORT if summary.faults > MAX_FAULTY_SHARE * summary.frames else EXIT_DONE


def _tracker(arguments: argparse.Namespace) -> TrackerSpec:
    """What `--tracker`, `--model` and `--raw` ask for together. Raises InputError when they contradict each other."""
    from uavfollow.trackers import MODEL_MARK, parse_spec

    if arguments.model is not None and MODEL_MARK in arguments.tracker:
        raise InputError(f"--model {arguments.model}: --tracker {arguments.tracker} names a model too; leave one out")
    spec = parse_spec(arguments.tracker, arguments.model or "")
    return replace(spec, raw=spec.raw or arguments.raw)


def _box_from(arguments: argparse.Namespace) -> str:
    """The option that gives the box."""
    if arguments.box:
        return "--box"
    return selecting.option_name(arguments) if selecting.is_wanted(arguments) else FROM_TRUTH


def _options(arguments: argparse.Namespace, out: Path, tlog: Path | None) -> TrackOptions:
    from uavfollow.track_run import TrackOptions

    return TrackOptions(
        tracker=_tracker(arguments),
        precision=arguments.precision,
        device=arguments.device,
        threads=_threads(arguments),
        box_from=_box_from(arguments),
        force=arguments.force or _box_from(arguments) == FROM_TRUTH,  # a data set's own target is never refused
        preset=arguments.preset,
        truth=str(arguments.truth) if arguments.truth else None,
        out=out,
        tlog=tlog,
        video=not arguments.no_video,
        hfov_rad=math.radians(arguments.hfov_deg),
        range_m=arguments.range_m,
        max_frames=arguments.max_frames,
    )


def _scorer(arguments: argparse.Namespace) -> Scorer:
    """The tracker that will follow the target judges the boxes of a click; it is built for it a second time."""
    from tracker.selection import SelfConsistency
    from uavfollow.trackers import build

    built = build(_tracker(arguments), arguments.precision, arguments.device, _threads(arguments))
    return SelfConsistency(lambda: built.tracker)


def _threads(arguments: argparse.Namespace) -> int:
    return arguments.threads or max(1, (os.cpu_count() or 1) - SPARE_CORES)


def _chosen(
    arguments: argparse.Namespace, truth: list[Box | None] | None, source: FrameSource, out: Path
) -> selecting.Choice:
    if selecting.is_wanted(arguments):
        chosen = selecting.choose(arguments, source, lambda: _scorer(arguments))
        for note in chosen.notes:
            tell(note) if arguments.json else print(note, flush=True)
        return chosen
    return selecting.Choice(_given_box(arguments, truth, source, out), {})


def _given_box(arguments: argparse.Namespace, truth: list[Box | None] | None, source: FrameSource, out: Path) -> Box:
    if arguments.box:
        return parse_box(arguments.box)
    if truth is not None:
        if truth[0] is None:
            raise InputError(f"--truth {arguments.truth}: the first row has no target; give the box with --box X,Y,W,H")
        return truth[0]
    grid = _write_grid(next(iter(source.frames()), None), out)
    raise InputError(
        f"no target given yet: look at {grid} and give a point on it in px as --click X,Y, its box as --box X,Y,W,H "
        "(top-left corner, width, height), or see what there is with --targets"
    )


def _write_grid(frame: Frame | None, out: Path) -> Path:
    from uavfollow.record.output import OutputFolder
    from uavfollow.video.overlay import draw_grid
    from uavfollow.video.writer import write_image

    if frame is None:
        raise InputError("the first frame cannot be read")
    folder = OutputFolder(out)
    try:
        write_image(folder.path(GRID_NAME), draw_grid(frame.image_bgr_u8))
        return folder.commit()[0]
    except BaseException:
        folder.abort()
        raise
