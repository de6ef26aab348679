"""GOT-10k: images beside groundtruth.txt in one folder, absence.label marks the frames without a target."""

from __future__ import annotations

import re
from pathlib import Path

from tracker.benchmark.readers.datasets import dataset_of, rate_fps
from tracker.benchmark.readers.entry import Entry, first_file, has_images
from tracker.benchmark.readers.otb import TRUTH_FILES

_RATE = re.compile(r"^\s*anno_fps\s*[:=]\s*(\d+(?:\.\d+)?)", re.MULTILINE)


def find(folder: Path) -> list[Entry]:
    """The sequence in this folder, or none."""
    truth = first_file(*(folder / f for f in reversed(TRUTH_FILES)))
    if truth is None or not has_images(folder):
        return []
    dataset = dataset_of(folder) or folder.resolve().parent.name
    fps = _stated_fps(folder / "meta_info.ini") or rate_fps(dataset)
    absence = first_file(folder / "absence.label")
    return [Entry(folder.resolve().name, dataset, folder, truth, fps=fps, absence=absence)]


def _stated_fps(meta: Path) -> float | None:
    """Rate of the annotated images, which is that of the images given; None when nothing usable is stated."""
    try:
        found = _RATE.search(meta.read_text(encoding="utf-8", errors="replace"))
    except OSError:
        return None
    return (float(found.group(1)) or None) if found else None
