"""A recipe: what a training run does, as a file says it. Every number has a range; unknown keys are errors."""

from __future__ import annotations

import unicodedata
from enum import Enum
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from tracker.config.fields import Bounds, Section

CONTROL = "Cc"  # Unicode's category
SHOWN = 40  # characters of a text in a message

Share = Annotated[float, Bounds(0.0, 1.0)]
Factor = Annotated[float, Bounds(0.0, 100.0)]
Count = Annotated[int, Bounds(1, 10_000_000_000, whole=True)]
Pixels = Annotated[int, Bounds(1, 10_000, whole=True)]
Rate = Annotated[float, Bounds(0.0, 1.0)]


def _printable(text: str) -> str:
    """A control character in a path or a name is a slip: no file is called so, and in a terminal it hides the rest."""
    wrong = next((c for c in text if unicodedata.category(c) == CONTROL), None)
    if wrong is not None:
        raise ValueError(f"{text[:SHOWN]!r}: holds the control character {wrong!r}; write it as one line of plain text")
    return text


Text = Annotated[str, Field(min_length=1, max_length=400), AfterValidator(_printable)]


class Variant(str, Enum):
    """The steps of the paper's component study. `aan` is SiamAPN++ itself; the others exist to be compared with it."""

    SIAMAPN = "siamapn"
    APN_DF = "apn_df"
    SELF_AAN = "self_aan"
    AAN = "aan"


class Labels(str, Enum):
    """`paper`: fixed thresholds on the anchors' overlap. `relative`: the best anchors, for networks of few pairs."""

    PAPER = "paper"
    RELATIVE = "relative"


class Start(Section):
    """Where the weights come from; without any of it, the official random initialisation.

    `model`: `s`, `full` or a .safetensors file of the same size. `widen`: the same of size `s`, for a run of `full`.
    `backbone`: a file with backbone tensors only (`backbone.layerN.*`, `layerN.*` or `features.layerN.*`).
    """

    model: Text | None = None
    widen: Text | None = None
    backbone: Text | None = None

    @model_validator(mode="after")
    def _one_network(self) -> Start:
        if self.model and self.widen:
            raise ValueError("give model or widen, not both")
        return self


class SourceBase(Section):
    """What all sources have. `share` is a weight among the sources: they are normalised."""

    share: Annotated[float, Bounds(1e-6, 1e6)] = 1.0
    name: Text | None = None
    frame_range: Annotated[int, Bounds(0, 100_000, whole=True)] = 50
    min_side_px: Annotated[float, Bounds(1.0, 1000.0)] = 12.0
    max_aspect: Annotated[float, Bounds(1.0, 100.0)] = 6.0
    max_area_share: Share = 0.7
    stride: Annotated[int, Bounds(1, 10_000, whole=True)] = 1
    only: tuple[str, ...] = ()  # sequences by name; all when empty
    exclude: tuple[str, ...] = ()


class Folders(SourceBase):
    """Sequences as folders: `SEQ/img/*.jpg` or `SEQ/*.jpg`, groundtruth_rect.txt or groundtruth.txt (LaSOT, UAV)."""

    kind: Literal["folders"]
    path: Text


class Got10k(SourceBase):
    """GOT-10k: `SEQ/00000001.jpg`, groundtruth.txt, absence.label, cover.label; list.txt where there is one."""

    kind: Literal["got10k"]
    path: Text


class Vid(SourceBase):
    """ImageNet VID: Annotations/VID/train/**/*.xml beside Data/VID/train/**/*.JPEG."""

    kind: Literal["vid"]
    path: Text
    frame_range: Annotated[int, Bounds(0, 100_000, whole=True)] = 100


class YoutubeBB(SourceBase):
    """YouTube-BB: the published CSV (youtube_id, timestamp_ms, ..., xmin, xmax, ymin, ymax) and frames on disk."""

    kind: Literal["youtube_bb"]
    annotations: Text
    images: Text
    pattern: Text = "{youtube_id}/{timestamp_ms}.jpg"
    frame_range: Annotated[int, Bounds(0, 100_000, whole=True)] = 3  # annotated frames, not milliseconds


class Coco(SourceBase):
    """COCO: instances_*.json and the folder of its images."""

    kind: Literal["coco"]
    annotations: Text
    images: Text


class Stills(SourceBase):
    """A table of still pictures: CSV with the columns image, x, y, w, h and, if you like, class."""

    kind: Literal["stills"]
    annotations: Text
    images: Text | None = None  # what the image column is relative to; the table's folder when not given


class VideoFiles(SourceBase):
    """Video files beside tables of the same name: CSV with the columns frame (from 0), x, y, w, h and, if you like,
    track and class."""

    kind: Literal["video_files"]
    path: Text


class Simulator(SourceBase):
    """Pictures that the simulator draws, with its truth: `sequences` of `frames` each, another world for each seed."""

    kind: Literal["simulator"]
    sequences: Annotated[int, Bounds(1, 10_000, whole=True)] = 8
    frames: Annotated[int, Bounds(2, 10_000, whole=True)] = 24
    seed: Annotated[int, Bounds(0, 2**31, whole=True)] = 0


class Packed(SourceBase):
    """Crops packed by `train prepare`: the source `set_name` of the pack in folder `path`."""

    kind: Literal["packed"]
    path: Text
    set_name: Text


AnySource = Annotated[
    Folders | Got10k | Vid | YoutubeBB | Coco | Stills | VideoFiles | Simulator | Packed, Field(discriminator="kind")
]


class Pairing(Section):
    """Which two views make a pair. Shares of all pairs; the rest are plain positives.

    `negative`: the search crop holds another target from anywhere, and no positive label. `distractor`: the same with
    another target of the same class. `patch`: self-supervised, any patch of a picture is the target.
    """

    negative: Share = 0.04
    distractor: Share = 0.02
    patch: Share = 0.08

    @model_validator(mode="after")
    def _shares_fit(self) -> Pairing:
        total = self.negative + self.distractor + self.patch
        if total > 1:
            raise ValueError(f"negative, distractor and patch add up to {total:g}; they are shares of all pairs")
        return self


class Augmentation(Section):
    """How often each effect is applied (share of crops) and its range. Exemplar and search are drawn independently."""

    flip: Share = 0.5  # of both crops together
    gray: Share = 0.06  # of both crops together
    colour: Share = 0.7
    gain: tuple[Factor, Factor] = (0.7, 1.35)
    offset: Annotated[float, Bounds(0.0, 255.0)] = 20.0  # +- grey levels
    cast: Annotated[float, Bounds(0.0, 255.0)] = 8.0  # standard deviation of the offset of each channel
    gamma: Share = 0.2
    motion_blur: Share = 0.12  # the effects from here to jpeg are for the search crop, at most one of them
    blur: Share = 0.05
    low_resolution: Share = 0.08
    noise: Share = 0.08
    fog: Share = 0.05
    jpeg: Share = 0.05
    exemplar_low_resolution: Share = 0.25  # a far target has few pixels
    occlusion: Share = 0.15  # by a patch of the same picture
    lookalike: Share = 0.08  # a copy of the target elsewhere in the search crop

    @model_validator(mode="after")
    def _effects_fit(self) -> Augmentation:
        total = self.motion_blur + self.blur + self.low_resolution + self.noise + self.fog + self.jpeg
        if total > 1:
            raise ValueError(f"motion_blur to jpeg add up to {total:g}; at most one is applied, so at most 1")
        if self.gain[0] > self.gain[1] or self.gain[0] <= 0:
            raise ValueError("gain must be a low and a high factor above 0")
        return self


class Jitter(Section):
    """How far crops are displaced and deformed, each uniform in +-: logarithms of factors, pixels, degrees."""

    shift_px: Annotated[float, Bounds(0.0, 200.0)] = 38.0
    log_scale: Annotated[float, Bounds(0.0, 1.5)] = 0.5
    log_aspect: Annotated[float, Bounds(0.0, 1.0)] = 0.3
    angle_deg: Annotated[float, Bounds(0.0, 45.0)] = 10.0  # of half of the crops
    exemplar_shift_px: Annotated[float, Bounds(0.0, 40.0)] = 6.0
    exemplar_log_scale: Annotated[float, Bounds(0.0, 0.5)] = 0.08
    exemplar_log_aspect: Annotated[float, Bounds(0.0, 0.5)] = 0.04
    exemplar_angle_deg: Annotated[float, Bounds(0.0, 45.0)] = 3.0


class LossWeights(Section):
    """total = cls (cls1 + cls2 + cls3 terms) + loc (l1 + iou terms) + anchor term, each with its weight."""

    cls1: Factor = 1.2
    cls2: Factor = 1.3
    cls3: Factor = 1.1
    cls: Factor = 1.0
    l1: Factor = 1.5
    iou: Factor = 1.0
    loc: Factor = 2.2
    anchor: Factor = 1.8


class Teacher(Section):
    """A trained network whose maps are learned beside the labels. Same output grid; any size."""

    model: Text
    weight: Factor = 1.0


class Optimiser(Section):
    """AdamW or SGD. `backbone_factor` scales the learning rate of the backbone; `clip` is the gradient's norm."""

    kind: Literal["adamw", "sgd"] = "adamw"
    backbone_factor: Factor = 0.5
    weight_decay: Annotated[float, Bounds(0.0, 1.0)] = 0.02
    decay_all: bool = False  # also biases and norms, as the paper's SGD does
    momentum: Share = 0.9  # of sgd; AdamW has betas 0.9, 0.98
    clip: Annotated[float, Bounds(1e-3, 1e6)] = 5.0
    max_loss: Annotated[float, Bounds(1.0, 1e9)] = 1e4  # a batch above it is skipped, as one that is not finite


class Curve(str, Enum):
    """The way from `lr` to `lr_end` over a stage, after the warm-up."""

    COSINE = "cosine"
    LOG = "log"
    CONSTANT = "constant"


class Stage(Section):
    """A part of a run: how large the crops, what is frozen, how fast it learns, how long. One of pairs, minutes.

    Minutes are those of the training; validations come on top.

    `frozen_layers`: the first so many backbone layers are fixed, their BatchNorm too (2 as in the paper; 5 is the whole
    backbone; 0 trains everything).
    """

    name: Text | None = None
    pairs: Count | None = None
    minutes: Annotated[float, Bounds(0.01, 1e6)] | None = None
    batch: Annotated[int, Bounds(1, 8192, whole=True)] = 16
    search_px: Annotated[int, Bounds(223, 511, whole=True)] = 223
    frozen_layers: Annotated[int, Bounds(0, 5, whole=True)] = 2
    lr: Rate = 4e-4
    lr_end: Rate = 0.0
    curve: Curve = Curve.COSINE
    warmup_pairs: Annotated[int, Bounds(0, 10_000_000_000, whole=True)] = 3200
    warmup_from: Share = 0.0  # share of lr at which the warm-up begins
    jitter: Jitter = Jitter()

    @model_validator(mode="after")
    def _whole(self) -> Stage:
        if (self.pairs is None) == (self.minutes is None):
            raise ValueError("give pairs or minutes, one of them")
        if (self.search_px - 127) % 8:
            raise ValueError(f"search_px {self.search_px} must be 127 + a multiple of 8 (223, 255, 287)")
        if self.curve is Curve.LOG and self.lr_end <= 0:
            raise ValueError("curve log needs lr_end above 0")
        return self


class Validation(Section):
    """The raw tracker over sequences that are never trained on: those of the same names are left out of all sources.

    Each is tracked `starts` times, from frames spread over it, at most `max_frames` each: one lost target in a dozen
    sequences moves the mean by more than a night of training does, so several starts tell more.
    """

    sources: tuple[AnySource, ...] = ()
    every_pairs: Count = 20_000
    starts: Annotated[int, Bounds(1, 1000, whole=True)] = 1
    max_frames: Annotated[int, Bounds(2, 1_000_000, whole=True)] | None = None


class Recipe(Section):
    """A whole run."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,40}$")]
    description: Text
    size: Literal["s", "full"] = "s"
    variant: Variant = Variant.AAN
    seed: Annotated[int, Bounds(0, 2**31, whole=True)] = 1
    start: Start = Start()
    sources: tuple[AnySource, ...]
    pairing: Pairing = Pairing()
    augmentation: Augmentation = Augmentation()
    labels: Labels = Labels.RELATIVE
    loss: LossWeights = LossWeights()
    teacher: Teacher | None = None
    optimiser: Optimiser = Optimiser()
    ema: Annotated[float, Bounds(0.0, 0.999999)] | None = 0.999  # decay per step; null: the weights themselves
    precision: Literal["auto", "fp32", "bf16", "fp16"] = "auto"
    stages: tuple[Stage, ...]
    checkpoint_minutes: Annotated[float, Bounds(0.01, 1e4)] = 10.0
    validation: Validation = Validation()

    @model_validator(mode="after")
    def _fits(self) -> Recipe:
        if not self.sources or not self.stages:
            raise ValueError("a recipe needs at least one source and one stage")
        if self.start.widen and self.size != "full":
            raise ValueError("start.widen makes a network of size full; set size: full")
        trained, kept = _simulator_seeds(self.sources), _simulator_seeds(self.validation.sources)
        if trained & kept:
            raise ValueError(
                f"the simulator's worlds {sorted(trained & kept)} are both trained and validated on; "
                "a source has the worlds seed to seed + sequences - 1: choose another seed for one of them"
            )
        return self


def _simulator_seeds(sources: tuple[AnySource, ...]) -> set[int]:
    """The worlds that the simulator draws for these sources."""
    drawn = [source for source in sources if isinstance(source, Simulator)]
    return {seed for source in drawn for seed in range(source.seed, source.seed + source.sequences)}
