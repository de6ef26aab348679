"""What a benchmark's means are made of: how much of each data set, whole or cut, at which rate, read or not."""

from __future__ import annotations

from dataclasses import dataclass

from tracker.benchmark import attributes as sets
from tracker.benchmark.readers.datasets import RATES_FPS
from uavfollow.benchmark import published
from uavfollow.benchmark.report import Report

# Sequences of the whole data set, as their papers count them. Those that come in several parts have no one number.
SIZES = {
    sets.UAV123: 123,
    sets.UAV123_10FPS: 123,
    sets.UAV20L: 20,
    sets.DTB70: 70,
    sets.UAVDT: 50,  # of its part for single objects
    sets.UAVTRACK112: 112,
}


@dataclass(frozen=True, slots=True)
class Coverage:
    """One data set, by the sequences that every tracker finished. `size` None: how many it has is not known here.

    `whole_frames` is what `frames` would be without a cut. `unread_frames`: images that no tracker could read, in
    `unread_sequences` of its sequences. `fps`: every rate that was used.
    """

    dataset: str
    sequences: int
    size: int | None
    frames: int
    whole_frames: int
    cut_sequences: int
    unread_frames: int
    unread_sequences: int
    fps: tuple[float, ...]

    @property
    def is_partial(self) -> bool:
        """Whether sequences of the data set, or ends of them, are missing."""
        return self.cut_sequences > 0 or (self.size is not None and self.sequences < self.size)

    @property
    def is_rate_assumed(self) -> bool:
        """Whether the data set does not state a rate, so that the reader assumed one."""
        return self.dataset not in RATES_FPS


def coverages(report: Report) -> tuple[Coverage, ...]:
    """Each data set of what is compared."""
    return tuple(_coverage(report, dataset) for dataset in report.datasets)


def notes(report: Report) -> list[str]:
    """What a reader of the means has to know, a sentence each; none when all is whole."""
    found = coverages(report)
    told = []
    cut = sum(one.cut_sequences for one in found)
    if cut:
        count = sum(one.sequences for one in found)
        told.append(
            f"Cut: of {cut} of the {count} sequences only the first {report.max_frames} images were tracked "
            "(--max-frames), which is easier than the whole."
        )
    for one in found:
        if one.size is not None and one.sequences < one.size:
            told.append(f"Partial: {one.sequences} of the {one.size} sequences of {one.dataset}.")
    unread = sum(one.unread_frames for one in found)
    if unread:
        places = sum(one.unread_sequences for one in found)
        told.append(
            f"Unread: {unread} images of {places} sequences could not be read; the trackers got no picture there, and "
            "they are scored."
        )
    if len(report.compared) < len(report.scores):
        told.append("Means are over the sequences that every tracker finished.")
    if report.further:
        told.append(
            f"Not shown: the folder also holds results of {', '.join(report.further)}; name all trackers in one "
            "--tracker to see them side by side (what is there is not tracked again)."
        )
    return told


def differences(report: Report) -> list[str]:
    """What keeps the means from being compared with the published ones; none: they compare directly."""
    found = coverages(report)
    differs = []
    if {one.dataset for one in found} != published.DATASETS:
        differs.append(f"are of {' and '.join(one.dataset for one in found)} alone")
    differs += [
        f"cover only {one.sequences} of the {one.size} sequences of {one.dataset}"
        for one in found
        if one.dataset in published.DATASETS and one.size is not None and one.sequences < one.size
    ]
    if any(one.cut_sequences for one in found):
        differs.append(f"end after the first {report.max_frames} images of a sequence")
    if any(one.unread_frames for one in found):
        differs.append("lack images that could not be read")
    if report.fps is not None:
        differs.append(f"were tracked as if at {report.fps:g} images per second (--fps)")
    if report.mode is not published.MODE:
        differs.append(f"are counted in mode `{report.mode.value}` (published: `{published.MODE.value}`)")
    return differs


def published_share(report: Report) -> tuple[int, int]:
    """Of how many sequences of the published tables ours are, and of how many those are."""
    ours = sum(one.sequences for one in coverages(report) if one.dataset in published.DATASETS)
    return ours, sum(SIZES[dataset] for dataset in published.DATASETS)


def _coverage(report: Report, dataset: str) -> Coverage:
    by_name = {}
    unread: dict[str, int] = {}
    for score in report.compared:
        if score.dataset == dataset:
            by_name[score.name] = score
            unread[score.name] = max(score.unread_frames, unread.get(score.name, 0))
    own = list(by_name.values())
    return Coverage(
        dataset=dataset,
        sequences=len(own),
        size=SIZES.get(dataset),
        frames=sum(score.frames for score in own),
        whole_frames=sum(score.whole_frames for score in own),
        cut_sequences=sum(score.is_cut for score in own),
        unread_frames=sum(unread.values()),
        unread_sequences=sum(count > 0 for count in unread.values()),
        fps=tuple(sorted({score.fps for score in own})),
    )
