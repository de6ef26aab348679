"""`uavfollow bench track`: trackers over annotated sequences, with tables, plots and files of every track."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uavfollow.cli.train import MAX_COUNT, check_range
from uavfollow.errors import EXIT_DONE, EXIT_INTERRUPTED, EXIT_SHORT
from uavfollow.interrupts import orderly_end
from uavfollow.tell import tell

if TYPE_CHECKING:
    from uavfollow.benchmark.options import BenchOptions
    from uavfollow.benchmark.run import BenchResult

VERB = "track"
MAX_JOBS = 256
MAX_FPS = 1000.0
DESCRIPTION = """Tracks every sequence from its first box with every tracker, by one thread each, and writes
DIR/TRACKER/DATASET/SEQUENCE.csv (boxes, status, confidence), .txt (x,y,w,h) and .json, table.md, summary.csv,
summary.json (which also tells what each column means) and plots. A finished sequence is not tracked again unless code,
weights, settings or images changed; the same command goes on where it was stopped. The tables show the trackers of
this command, from all that DIR holds of them. PATH is a folder: a sequence, a data set (UAV123, UAV123@10fps, UAV20L,
DTB70, UAVDT, VisDrone-SOT, UAVTrack112, GOT-10k, or folders with img/ and groundtruth_rect.txt), or a folder of
them. The exit code is 1 when a sequence could not be tracked or read."""


def add_verb(verbs: Any) -> None:
    """Add the command to those of `bench`."""
    parser = verbs.add_parser(VERB, help="trackers over annotated sequences", description=DESCRIPTION)
    parser.add_argument("paths", metavar="PATH", nargs="+", type=Path, help="sequence, data set, or a folder of them")
    parser.add_argument(
        "--tracker",
        metavar="SPEC,SPEC",
        action="append",
        help="NAME[@MODEL][+raw], several with commas; +raw: the bare tracker (default: siamapnpp)",
    )
    parser.add_argument("--model", default="", help="for trackers that name none: s, full or a .safetensors file")
    parser.add_argument("--mode", choices=["honest", "toolkit"], default="honest", help="scoring (default: honest)")
    parser.add_argument("--jobs", metavar="N", type=int, default=1, help="sequences at the same time (default: 1)")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder of the results; may grow")
    parser.add_argument("--fps", metavar="FPS", type=float, help="rate of the images (default: as the data set says)")
    parser.add_argument("--max-frames", metavar="N", type=int, help="of each sequence only the first so many images")
    parser.add_argument("--precision", choices=["auto", "fp32", "bf16"], default="auto")
    parser.add_argument("--device", choices=["auto", "cpu", "cuda"], default="auto")
    parser.add_argument("--json", action="store_true", help="print summary.json instead of the means")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    check_range("--jobs", arguments.jobs, 1, MAX_JOBS)
    check_range("--fps", arguments.fps, 1.0, MAX_FPS)
    check_range("--max-frames", arguments.max_frames, 2, MAX_COUNT)
    options = _options(arguments)
    from uavfollow.benchmark.run import run_bench  # only now: it imports the plots

    try:
        with orderly_end():
            result = run_bench(options)
    except KeyboardInterrupt:
        tell("stopped; what was finished is kept, and the same command goes on where it was")
        return EXIT_INTERRUPTED
    _show(result, arguments.json)
    return EXIT_SHORT if result.report.failures else EXIT_DONE


def _options(arguments: argparse.Namespace) -> BenchOptions:
    from tracker.benchmark.scores import Mode
    from uavfollow.benchmark.options import BenchOptions, chosen_trackers
    from uavfollow.trackers import DEFAULT_NAME

    return BenchOptions(
        paths=tuple(arguments.paths),
        trackers=chosen_trackers(arguments.tracker or [DEFAULT_NAME], arguments.model),
        out=arguments.out,
        mode=Mode(arguments.mode),
        jobs=arguments.jobs,
        precision=arguments.precision,
        device=arguments.device,
        fps=arguments.fps,
        max_frames=arguments.max_frames,
    )


def _show(result: BenchResult, as_json: bool) -> None:
    from uavfollow.benchmark.files import as_json as summary
    from uavfollow.benchmark.tables import as_text

    report = result.report
    if as_json:
        print(json.dumps(summary(report), indent=1, allow_nan=False))
        return
    lines = as_text(report)
    if report.reused:
        lines.append(f"{report.reused} tracks lay there already and were not repeated")
    if report.failures:
        lines.append(f"{len(report.failures)} not scored; the first: {report.failures[0]}")
    print("\n".join([*lines, *(f"  wrote {path}" for path in result.files)]))
