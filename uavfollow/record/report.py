"""report.html of a run: numbers, snapshots and plots on one page that needs no network."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from tracker.benchmark.scores import centre_errors_px
from tracker.messages import ImageU8, TargetStatus
from uavfollow.app import StepRecord
from uavfollow.record.output import RUN_FILES, OutputFolder
from uavfollow.record.plots import plot_centre_error, plot_commands
from uavfollow.record.summary import TrackSummary, Truth
from uavfollow.video.writer import write_image

SNAPSHOTS = 6
SETTLED_FRAMES = 5  # a status that ends before is not worth a picture
COLUMNS = 3
TILE_PX = 480
UNKNOWN_LENGTH_STRIDE = 100  # frames between snapshots when the length is not known

LINKED = ("overlay.mp4", "track.csv", "commands.csv")
PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>{title}</title>
<style>body{{font:15px/1.5 system-ui,sans-serif;max-width:1080px;margin:2em auto;padding:0 1em;color:#222}}
img{{max-width:100%}}pre{{background:#f4f4f4;padding:1em;overflow:auto}}</style>
<h1>{title}</h1>
<pre>{numbers}</pre>
{body}
<p>{links}</p>
<p>Thick box: the estimate, coloured by status; thin white box: the truth; circle: where the centre is to two
sigma while it is not seen; cross: the middle of the picture.</p>
<p>Setpoints: <code>{tlog}</code> (<code>mavlogdump.py {tlog}</code> prints them). They are open loop: a camera that
looks straight forward from a hovering vehicle and does not move; metres scale with the assumed range.</p>
</html>
"""


class Snapshots:
    """A few overlay pictures through the run, in order, with every status that lasted among them."""

    def __init__(self, count: int | None) -> None:
        self._stride = max(1, count // SNAPSHOTS) if count else UNKNOWN_LENGTH_STRIDE
        self._images: list[ImageU8] = []
        self._shown: set[TargetStatus] = set()
        self._status: TargetStatus | None = None
        self._since = self._spaced = 0

    def wants(self, number: int, status: TargetStatus) -> bool:
        """Whether frame `number` is one of them: evenly spaced ones, and one of each status soon after it began."""
        if status is not self._status:
            self._status, self._since = status, number
        # The next place of the even spacing has come; numbers may be left out, when pictures were dropped.
        spaced = self._spaced < SNAPSHOTS and number >= self._spaced * self._stride + self._stride // 2
        self._spaced += spaced
        settled = status not in self._shown and number >= self._since + SETTLED_FRAMES
        if settled:
            self._shown.add(status)
        return spaced or settled

    def add(self, image: ImageU8) -> None:
        """Keep a scaled copy."""
        scale = TILE_PX / image.shape[1]
        size = (TILE_PX, max(1, round(image.shape[0] * scale)))
        self._images.append(np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8))

    def sheet(self) -> ImageU8 | None:
        """All of them side by side, None when there are none."""
        if not self._images:
            return None
        blank = np.full_like(self._images[0], 255)
        padded = [*self._images, *[blank] * (-len(self._images) % COLUMNS)]
        rows = [np.hstack(padded[i : i + COLUMNS]) for i in range(0, len(padded), COLUMNS)]
        return np.vstack(rows)


def write_report(
    folder: OutputFolder,
    summary: TrackSummary,
    records: Sequence[StepRecord],
    truth: Truth,
    snapshots: Snapshots,
    tlog: str,
) -> None:
    """Write report.html and its pictures into the folder. `tlog` is where the setpoints are."""
    title = f"{summary.source}, model {summary.model}{', raw tracker' if summary.settings.get('raw') else ''}"
    body = []
    sheet = snapshots.sheet()
    if sheet is not None:
        write_image(folder.path("snapshots.jpg"), sheet)
        body.append('<img src="snapshots.jpg" alt="snapshots">')
    if truth is not None:
        errors = centre_errors_px([r.target.box for r in records], truth[: len(records)])
        plot_centre_error(folder.path("centre_error.png"), records, errors, title)
        body.append('<img src="centre_error.png" alt="centre error over time">')
    plot_commands(folder.path("commands.png"), records, title)
    body.append('<img src="commands.png" alt="confidence and setpoints over time">')
    numbers = html.escape("\n".join(summary.lines()))
    written = [n for n in LINKED if (folder.work / n).exists()]
    links = "Files: " + ", ".join(f'<a href="{n}">{n}</a>' for n in [*written, "summary.json"])
    page = PAGE.format(
        title=html.escape(title), numbers=numbers, body="\n".join(body), tlog=html.escape(tlog), links=links
    )
    folder.path("report.html").write_text(page)
    names = sorted({*(p.name for p in folder.work.iterdir() if p.suffix != ".partial"), "summary.json", tlog})
    kept = summary.with_files(
        [folder.target / name if name != tlog or name in RUN_FILES else Path(name) for name in names]
    )
    folder.path("summary.json").write_text(kept.json() + "\n")
