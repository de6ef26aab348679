"""Tiny data sets on disk. Images are empty files: no reader looks into them."""

from pathlib import Path


def pictures(folder: Path, numbers, pattern: str = "{:06d}.jpg") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        (folder / pattern.format(number)).touch()
    return folder


def text(path: Path, content: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode())
    return path


def rows(count: int, first: int = 10, separator: str = ",") -> str:
    """`count` rows whose x counts up from `first`, so that every row is told from every other."""
    return "".join(separator.join(map(str, (first + i, 20, 30, 40))) + "\n" for i in range(count))


def otb(folder: Path, count: int = 3, content: str | None = None) -> Path:
    pictures(folder / "img", range(1, count + 1))
    text(folder / "groundtruth_rect.txt", rows(count) if content is None else content)
    return folder
