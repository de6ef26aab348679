"""What a simulated run writes while it goes: the tlog of the link, the overlay video, snapshots."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from sitl.run import RunLog, Step
from sitl.scenario.schema import Scenario
from tracker.box import Box
from tracker.messages import ImageU8
from uavfollow.mavlink.tlog import TlogWriter
from uavfollow.record.output import OutputFolder
from uavfollow.record.report import Snapshots
from uavfollow.sim.steps_csv import write_steps_csv
from uavfollow.video.overlay import draw_notice, draw_state
from uavfollow.video.writer import VideoSink

# What a simulated run may write; one that an earlier run left and this one does not make is deleted.
SIM_FILES = (
    "run.json", "steps.csv", "report.html", "timeline.png", "top_view.png", "snapshots.jpg", "overlay.mp4", "link.tlog",
)  # fmt: skip


class SimFiles:
    """Everything is made in a hidden folder: complete after `commit`, without a trace after `abort`."""

    def __init__(self, out: Path, video: bool, scenario: Scenario) -> None:
        self.folder = OutputFolder(out)
        self._done = False
        self._tlog: TlogWriter | None = None
        self._target = scenario.target.name
        self._label = f"sim {scenario.name}"
        self._last: ImageU8 | None = None
        self._written = 0
        try:
            for name in SIM_FILES:
                self.folder.path(name)  # says now, not after the flight, when a folder is in the way
            self._tlog = TlogWriter(self.folder.path("link.tlog"))
            size = (scenario.camera.width_px, scenario.camera.height_px)
            self._video = VideoSink(self.folder.path("overlay.mp4"), scenario.fps, size) if video else None
        except BaseException:
            self.abort()
            raise
        self._first_seq: int | None = None
        self.snapshots = Snapshots(round(scenario.duration_s * scenario.fps))

    def tap(self, unix_us: Callable[[], int]) -> Callable[[bytes], None]:
        """For `Connection`: every frame of the link, both ways, into the tlog."""
        assert self._tlog is not None
        writer = self._tlog

        def write(frame: bytes) -> None:
            writer.write(unix_us(), frame)

        return write

    def add(self, step: Step, begin_s: float) -> None:
        """Take a step as it comes: its picture goes into the video, repeated for the pictures that were dropped."""
        if step.seen.image_bgr_u8 is None:
            return
        record = step.decision.record
        image = draw_state(step.seen.image_bgr_u8, record.step.target, _truth(step), self._label)
        fault = step.decision.fault
        image = draw_notice(image, fault or _flight_line(step, begin_s), is_fault=fault is not None)
        if self._first_seq is None:
            self._first_seq = step.seen.seq
        number = step.seen.seq - self._first_seq
        if self.snapshots.wants(number, record.step.target.status):
            self.snapshots.add(image)
        if self._video is not None:
            while self._last is not None and self._written < number:
                self._video.write(self._last)
                self._written += 1
            self._video.write(image)
            self._written = number + 1
        self._last = image

    def finish(self, log: RunLog) -> None:
        """Complete video and table."""
        write_steps_csv(self.folder.path("steps.csv"), log.steps, log.begin_s)
        if self._video is not None and self._last is not None:
            self._video.close()
        elif self._video is not None:  # nothing was ever selected: a film without a picture is no film
            self._video.discard()

    def commit(self) -> list[Path]:
        """Put everything into place; returns the paths."""
        assert self._tlog is not None
        self._tlog.close()
        placed = self.folder.commit(replaces=SIM_FILES)
        self._done = True
        return placed

    def abort(self) -> None:
        """Delete everything that was not committed."""
        if self._done:
            return
        try:
            if self._tlog is not None:
                self._tlog.abort()
        finally:
            self.folder.abort()


def _truth(step: Step) -> Box | None:
    truth = step.sample.truth
    return truth.visible if truth is not None else None


def _flight_line(step: Step, begin_s: float) -> str:
    sample, decision = step.sample, step.decision
    when = f"{sample.t_s - begin_s:5.1f} s  "
    if not sample.command_sent:
        return f"{when}no setpoints ({decision.flight_reason})"
    north, east, _ = sample.command_v_ned_m_s
    return f"{when}{math.hypot(north, east):.1f} m/s  {sample.command_reason}"
