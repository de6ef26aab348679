"""Tiny data sets of every published format, drawn: a textured target on a plain ground whose grey tells the frame."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 160, 120
XYWH = tuple[float, float, float, float]
FIRST_BOX: XYWH = (40.0, 30.0, 32.0, 24.0)
STEP_PX = (3.0, 2.0)  # how far the target moves from frame to frame


def box_at(frame: int) -> XYWH:
    """Where the target of the drawn sequences is: x, y, w, h."""
    x, y, w, h = FIRST_BOX
    return x + STEP_PX[0] * frame, y + STEP_PX[1] * frame, w, h


def ground_bgr(frame: int, seed: int = 0) -> tuple[int, int, int]:
    """The colour of the ground in a frame: far enough from that of any other to survive JPEG and MPEG."""
    return 20 + 12 * (frame % 18), 60 + 20 * (seed % 8), 200 - 10 * (frame % 18)


def picture(box: XYWH | None, frame: int = 0, seed: int = 0, size: tuple[int, int] = (WIDTH, HEIGHT)) -> np.ndarray:
    """A picture (H, W, 3) of the ground with the target at `box`, if any."""
    image = np.full((size[1], size[0], 3), ground_bgr(frame, seed), np.uint8)
    if box is None:
        return image
    rng = np.random.default_rng([seed, 1])
    texture = rng.integers(0, 256, (6, 6, 3)).astype(np.uint8)
    x, y = round(box[0]), round(box[1])
    patch = cv2.resize(texture, (max(1, round(box[2])), max(1, round(box[3]))), interpolation=cv2.INTER_NEAREST)
    left, top, right, bottom = max(0, x), max(0, y), min(size[0], x + patch.shape[1]), min(size[1], y + patch.shape[0])
    if left < right and top < bottom:
        image[top:bottom, left:right] = patch[top - y : bottom - y, left - x : right - x]
    return image


def write(path: Path, image: np.ndarray) -> None:
    """Write a picture and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def make_sequence(
    folder: Path,
    frames: int = 6,
    seed: int = 0,
    boxes: Sequence[XYWH | None] | None = None,
    images: str = "img",
    truth: str = "groundtruth_rect.txt",
    separator: str = ",",
    suffix: str = ".jpg",
) -> None:
    """One sequence: pictures in `folder/images` (`.`: in the folder itself) and a row of the truth for each."""
    boxes = [box_at(i) for i in range(frames)] if boxes is None else boxes
    for i, box in enumerate(boxes):
        write(folder / images / f"{i + 1:08d}{suffix}", picture(box, i, seed))
    rows = [separator.join("nan" if box is None else f"{v:g}" for v in box or (0, 0, 0, 0)) for box in boxes]
    (folder / truth).write_text("\n".join(rows) + "\n")


def make_folders(path: Path, names: Sequence[str] = ("one", "two"), frames: int = 6) -> Path:
    """Sequences as OTB and UAV have them: `NAME/img/00000001.jpg`, groundtruth_rect.txt. Returns `path`."""
    for seed, name in enumerate(names):
        make_sequence(path / name, frames, seed)
    return path


def make_got10k(path: Path, names: Sequence[str] = ("GOT_1", "GOT_2"), frames: int = 6) -> Path:
    """A split of GOT-10k with its list and labels: nothing absent, everything covered at level 8."""
    for seed, name in enumerate(names):
        make_sequence(path / name, frames, seed, images=".", truth="groundtruth.txt")
        (path / name / "absence.label").write_text("0\n" * frames)
        (path / name / "cover.label").write_text("8\n" * frames)
        (path / name / "meta_info.ini").write_text("[METAINFO]\nobject_class: bear\nmotion_class: walking\n")
    (path / "list.txt").write_text("\n".join(names) + "\n")
    return path


def make_stills(path: Path, pictures: int = 4, boxes: int = 2, label: str = "car") -> Path:
    """A table of still pictures with `boxes` targets each, side by side. Returns the table's path."""
    rows = []
    for i in range(pictures):
        image = picture(None, i, i)
        for n in range(boxes):
            box = (10.0 + 60 * n, 20.0 + 2 * i, 40.0, 30.0)
            image[round(box[1]) :, round(box[0]) :] = picture(box, i, i + n)[round(box[1]) :, round(box[0]) :]
            rows.append([f"images/{i:03d}.jpg", *(f"{v:g}" for v in box), label])
        write(path / "images" / f"{i:03d}.jpg", image)
    table = path / "annotations.csv"
    with table.open("w", newline="") as file:
        csv.writer(file).writerows([["image", "x", "y", "w", "h", "class"], *rows])
    return table


def make_coco(path: Path, pictures: int = 3) -> tuple[Path, Path]:
    """COCO with a cat in each picture, a dog too in the first, and a crowd. Returns table and folder of images."""
    images, annotations = [], []
    for i in range(pictures):
        write(path / "images" / f"{i:012d}.jpg", picture(box_at(i), i, i))
        images.append({"id": 100 + i, "file_name": f"{i:012d}.jpg", "width": WIDTH, "height": HEIGHT, "license": 1})
        annotations.append(_annotation(i, 100 + i, 17, box_at(i)))
    annotations.append(_annotation(50, 100, 18, (5.0, 6.0, 20.0, 25.0)))
    annotations.append(_annotation(51, 100, 18, (0.0, 0.0, 100.0, 90.0), crowd=1))
    table = path / "instances_tiny.json"
    categories = [{"id": 17, "name": "cat", "supercategory": "animal"}, {"id": 18, "name": "dog"}]
    table.write_text(json.dumps({"images": images, "annotations": annotations, "categories": categories}))
    return table, path / "images"


def _annotation(number: int, image: int, category: int, box: XYWH, crowd: int = 0) -> dict[str, object]:
    x, y, w, h = box
    outline: object = {"counts": [1, 2], "size": [HEIGHT, WIDTH]} if crowd else [[x, y, x + w, y, x + w, y + h]]
    return {
        "id": number,
        "image_id": image,
        "category_id": category,
        "bbox": list(box),
        "iscrowd": crowd,
        "area": w * h,
        "segmentation": outline,
    }


def make_vid(path: Path, frames: int = 4) -> Path:
    """ImageNet VID with one video: a bird (n01503061) in all frames and a dog (n02084071) in the first two."""
    part = "train/ILSVRC2015_VID_train_0000/ILSVRC2015_train_00000000"
    for i in range(frames):
        write(path / "Data" / "VID" / part / f"{i:06d}.JPEG", picture(box_at(i), i))
        objects = vid_object(0, "n01503061", box_at(i))
        if i < 2:
            objects += vid_object(1, "n02084071", (5.0, 6.0, 20.0, 25.0))
        xml = path / "Annotations" / "VID" / part / f"{i:06d}.xml"
        xml.parent.mkdir(parents=True, exist_ok=True)
        xml.write_text(
            f"<annotation><folder>ILSVRC2015_train_00000000</folder><filename>{i:06d}</filename>"
            f"<size><width>{WIDTH}</width><height>{HEIGHT}</height></size>{objects}</annotation>"
        )
    return path


def vid_object(track: int, name: str, box: XYWH) -> str:
    """One object of a VID annotation."""
    x, y, w, h = box
    return (
        f"<object><trackid>{track}</trackid><name>{name}</name><bndbox><xmax>{x + w:g}</xmax><xmin>{x:g}</xmin>"
        f"<ymax>{y + h:g}</ymax><ymin>{y:g}</ymin></bndbox><occluded>0</occluded><generated>0</generated></object>"
    )


def make_youtube_bb(path: Path, frames: int = 4) -> tuple[Path, Path]:
    """YouTube-BB without a header, as published: video `vidA` at 1 Hz. Returns table and folder of images."""
    rows = []
    for i in range(frames):
        x, y, w, h = box_at(i)
        relative = (x / WIDTH, (x + w) / WIDTH, y / HEIGHT, (y + h) / HEIGHT)
        rows.append(["vidA", str(1000 * i), "2", "car", "0", "present", *(f"{v:.6f}" for v in relative)])
        write(path / "images" / "vidA" / f"{1000 * i}.jpg", picture(box_at(i), i))
    table = path / "yt_bb_detection_train.csv"
    with table.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    return table, path / "images"


def make_video(path: Path, frames: int = 40, seed: int = 0) -> None:
    """A video whose frames differ in the colour of the ground."""
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 25.0, (WIDTH, HEIGHT))
    assert writer.isOpened()
    for i in range(frames):
        writer.write(picture(box_at(i % 18), i, seed))
    writer.release()


def make_video_files(path: Path, names: Sequence[str] = ("clip",), frames: int = 40) -> Path:
    """Videos beside their tables, one box per frame. Returns `path`."""
    for seed, name in enumerate(names):
        make_video(path / f"{name}.mp4", frames, seed)
        with (path / f"{name}.csv").open("w", newline="") as file:
            rows = [[i, *(f"{v:g}" for v in box_at(i % 18)), "drone"] for i in range(frames)]
            csv.writer(file).writerows([["frame", "x", "y", "w", "h", "label"], *rows])
    return path
