"""One tracking run over recorded material: the loop, its files and its summary."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from control.camera import Intrinsics
from control.gimbal import GimbalLaw, GimbalLawConfig
from control.guidance.trail import TrailConfig, TrailGuidance
from control.limits import VelocityLimiter, VelocityLimits
from control.messages import GimbalFrame, GimbalState, VehicleState
from tracker.box import Box
from tracker.messages import Frame, ImageU8
from tracker.presets import PRESETS, TargetKind
from tracker.selection import unsuitable
from tracker.siamapnpp.tracker import check_box
from uavfollow import __version__
from uavfollow.app import App, StepRecord, Telemetry
from uavfollow.errors import InputError
from uavfollow.progress import Progress
from uavfollow.record.commands_csv import CommandsCsv
from uavfollow.record.output import RUN_FILES, OutputFolder
from uavfollow.record.report import Snapshots, write_report
from uavfollow.record.setpoints import SetpointTlog
from uavfollow.record.summary import TrackSummary, Truth, summarise
from uavfollow.record.track_csv import TrackCsv
from uavfollow.stopwatch import Stopwatch
from uavfollow.trackers import DEFAULT_NAME, TrackerSpec, build, make_target
from uavfollow.video.overlay import draw_notice, draw_state
from uavfollow.video.source import FrameSource
from uavfollow.video.writer import VideoSink

MIN_STANDOFF_SHARE = 0.3  # of the assumed range: nearer than that a fixed camera would have lost the target


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """What the user chose. `tlog` None puts the setpoints into `out`.

    `box_from` names the option that the box comes from; with `force` one that is unsuitable as a target is taken too.
    """

    tracker: TrackerSpec
    precision: str
    device: str
    threads: int
    box_from: str
    force: bool
    preset: str | None
    truth: str | None
    out: Path
    tlog: Path | None
    video: bool
    hfov_rad: float
    range_m: float
    max_frames: int | None


class TrackFiles:
    """Everything that a run writes: complete after `commit`, without a trace after `abort`."""

    def __init__(self, options: TrackOptions, fps: float, size_px: tuple[int, int]) -> None:
        self.folder = OutputFolder(options.out)
        self.tlog_elsewhere = options.tlog
        self._tlog: SetpointTlog | None = None
        try:
            self._csv = TrackCsv(self.folder.path("track.csv"))
            self._commands = CommandsCsv(self.folder.path("commands.csv"))
            self._tlog = SetpointTlog(options.tlog or self.folder.path("setpoints.tlog"), time.time_ns() // 1000)
            self._video = VideoSink(self.folder.path("overlay.mp4"), fps, size_px) if options.video else None
        except BaseException:
            self.abort()
            raise

    def write(self, record: StepRecord, overlay: ImageU8 | None) -> None:
        """Append one step."""
        assert self._tlog is not None
        self._csv.write(record.seq, record.target)
        self._commands.write(record)
        self._tlog.write(record)
        if self._video is not None and overlay is not None:
            self._video.write(overlay)

    def finish(self, t_s: float) -> None:
        """Complete rows and video; the setpoint stream ends with an explicit stop."""
        self._csv.close()
        self._commands.close()
        if self._video is not None:
            self._video.close()
        assert self._tlog is not None
        self._tlog.stop(t_s)

    def commit(self) -> list[Path]:
        """Put everything into place; returns the paths."""
        assert self._tlog is not None
        self._tlog.close()
        placed = self.folder.commit(replaces=RUN_FILES)
        return placed if self.tlog_elsewhere is None else [*placed, self.tlog_elsewhere]

    def abort(self) -> None:
        """Delete everything."""
        try:
            if self._tlog is not None:
                self._tlog.abort()
        finally:
            self.folder.abort()


class TrackRun:
    """The loop over one source. Holds the records and the snapshots for the report."""

    def __init__(self, app: App, source: FrameSource, truth: Truth, options: TrackOptions, watch: Stopwatch) -> None:
        self._app = app
        self._truth = truth
        self._watch = watch
        limits = [n for n in (source.count, options.max_frames) if n is not None]
        self._count = min(limits) if limits else None
        self._period_s = 1.0 / source.fps
        self._draws = options.video
        self._label = f"{source.name}  model {model_name(options)}{'  raw tracker' if options.tracker.raw else ''}"
        self._progress = Progress(self._count)
        self.records: list[StepRecord] = []
        self.snapshots = Snapshots(self._count)

    def run(self, first: Frame, rest: Iterator[Frame | None], box: Box, files: TrackFiles) -> bool:
        """Every frame of the source; returns whether the user interrupted."""
        last = first
        try:
            t_s = first.t_capture_s
            self._keep(self._app.start(first, box, assumed_telemetry(t_s), t_s), last, files)
            for frame in self._timed(rest):
                t_s = frame.t_capture_s if frame is not None else t_s + self._period_s
                record = self._app.step(frame, assumed_telemetry(t_s), t_s)
                if frame is not None and frame.image_bgr_u8.shape == first.image_bgr_u8.shape:
                    last = frame
                self._keep(record, last, files)
        except KeyboardInterrupt:
            if not self.records:  # nothing to keep
                raise
            return True
        finally:
            self._progress.close()
        return False

    def _timed(self, rest: Iterator[Frame | None]) -> Iterator[Frame | None]:
        """The rest of the frames, up to the limit, with the time that reading them takes."""
        while self._count is None or len(self.records) < self._count:
            with self._watch.section("read"):
                try:
                    frame = next(rest)
                except StopIteration:
                    return
            yield frame

    def _keep(self, record: StepRecord, last: Frame, files: TrackFiles) -> None:
        with self._watch.section("write"):
            number = len(self.records)
            truth = self._truth[number] if self._truth is not None else None
            wanted = self.snapshots.wants(number, record.target.status)
            overlay = (
                draw_state(last.image_bgr_u8, record.target, truth, self._label) if self._draws or wanted else None
            )
            if overlay is not None and record.fault is not None:
                overlay = draw_notice(overlay, record.fault)
            files.write(record, overlay if self._draws else None)
            if wanted and overlay is not None:
                self.snapshots.add(overlay)
            self.records.append(record)
            self._progress.show(number + 1, record.target)


def run_track(source: FrameSource, box: Box, truth: Truth, options: TrackOptions) -> TrackSummary:
    """Track `box` through the source and write the results.

    Raises InputError, and leaves nothing behind, when source, box, weights or output cannot be used. An interruption
    keeps what there is so far: that is how a camera run ends.
    """
    watch = Stopwatch()
    frames = iter(source.frames())
    with watch.section("read"):
        first = next(frames, None)
    if first is None:
        raise InputError(f"{source.name}: the first frame cannot be read")
    size_px = (first.image_bgr_u8.shape[1], first.image_bgr_u8.shape[0])
    _check_start(box, first, options)
    app, engine = _build(options, size_px, watch)
    files = TrackFiles(options, source.fps, size_px)
    try:
        run = TrackRun(app, source, truth, options, watch)
        interrupted = run.run(first, frames, box, files)
        files.finish(run.records[-1].t_s)
        summary = summarise(
            source.name, source.fps, run.records, truth, model_name(options), engine, watch.spent_s,
            _settings(options, source, box), interrupted,
        )  # fmt: skip
        write_report(files.folder, summary, run.records, truth, run.snapshots, str(options.tlog or "setpoints.tlog"))
        return summary.with_files(files.commit())
    except OSError as error:
        files.abort()
        raise InputError(
            f"--out {options.out}: {error.strerror or error}; free some space or choose another"
        ) from error
    except BaseException:
        files.abort()
        raise


def _check_start(box: Box, first: Frame, options: TrackOptions) -> None:
    """Raise InputError when a track cannot, or without `force` should not, start at the box."""
    image = first.image_bgr_u8
    try:
        check_box(box, image.shape[1], image.shape[0])
    except ValueError as error:
        raise InputError(f"{options.box_from}: {error}") from error
    reason = None if options.force else unsuitable(image, box)
    if reason is not None:
        given = ",".join(f"{v:g}" for v in box.to_xywh())
        raise InputError(
            f"{options.box_from}: the box {given} is unsuitable ({reason.value}): {reason.message}; --force overrides"
        )


def _settings(options: TrackOptions, source: FrameSource, box: Box) -> dict[str, str | float | bool | None]:
    return {
        "box": ",".join(f"{v:g}" for v in box.to_xywh()),
        "fps": source.fps,
        "hfov_deg": round(math.degrees(options.hfov_rad), 3),
        "range_m": options.range_m,
        "max_frames": options.max_frames,
        "preset": options.preset,
        "raw": options.tracker.raw,
        "source": source.origin,
        "tracker": options.tracker.name,
        "truth": options.truth,
        "version": __version__,
    }


def _build(options: TrackOptions, size_px: tuple[int, int], watch: Stopwatch) -> tuple[App, str]:
    built = build(options.tracker, options.precision, options.device, options.threads)
    preset = None if options.preset is None else PRESETS[TargetKind(options.preset)]
    target_config, filter_config = (None, None) if preset is None else (preset.target, preset.filter)
    trail = TrailConfig(standoff_m=options.range_m, min_standoff_m=max(1.0, MIN_STANDOFF_SHARE * options.range_m))
    app = App(
        tracker=built.tracker,
        target=make_target(options.tracker, built, target_config, filter_config),
        gimbal_law=GimbalLaw(GimbalLawConfig()),
        guidance=TrailGuidance(trail),
        limiter=VelocityLimiter(VelocityLimits()),
        intrinsics=Intrinsics.from_hfov(*size_px, options.hfov_rad),
        reference_range_m=options.range_m,
        stopwatch=watch,
    )
    return app, f"{built.engine}, {options.threads} thread{'s' if options.threads > 1 else ''}"


def model_name(options: TrackOptions) -> str:
    """What tells the reader which network ran: the model alone, with the tracker's name where that is another."""
    spec = options.tracker
    return spec.model if spec.name == DEFAULT_NAME else str(replace(spec, raw=False))


def assumed_telemetry(now_s: float) -> Telemetry:
    """A hovering vehicle, nose north, whose gimbal looks straight forward: recorded video has no telemetry."""
    level = (0.0, 0.0, 0.0)
    vehicle = VehicleState(now_s, *level, level, level, attitude_valid=True, position_valid=True, source="assumed")
    gimbal = GimbalState(now_s, 0.0, 0.0, GimbalFrame.VEHICLE, valid=True, source="assumed")
    return Telemetry(vehicle, gimbal)
