"""A contact sheet of training pairs with their labels drawn: what the network is going to be taught."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch

from tracker.messages import ImageU8
from tracker.siamapnpp.crop import EXEMPLAR_PX, exemplar_side_px
from tracker.training.types import Batch

GAP_PX = 4
CAPTION_PX = 16
TEXT_SCALE = 0.4
PAPER_BGR, INK_BGR = (40, 40, 40), (230, 230, 230)
LABEL_BGR = (80, 255, 80)
NEGATIVE_BGR = (40, 40, 255)
NEGATIVE_FRAME_PX = 3


def contact_sheet(batches: Batch | Sequence[Batch], columns: int = 8) -> ImageU8:
    """All pairs as one BGR picture, `columns` pairs side by side: exemplar, search crop with the label's box.

    The caption counts the pairs and gives the target's size relative to its exemplar's undisturbed size; pairs
    without a target have no box and a red frame. Search crops of all batches must be of one size.
    Raises ValueError without a pair, without a column or with different sizes.
    """
    batches = [batches] if isinstance(batches, Batch) else list(batches)
    sizes = {batch.search.shape[-1] for batch in batches}
    count = sum(len(batch.negative) for batch in batches)
    if columns < 1 or not count or len(sizes) != 1:
        raise ValueError(
            f"contact sheet of {count} pairs in {columns} columns, sizes {sorted(sizes)}: needs one of each"
        )
    search_px = sizes.pop()
    columns = min(columns, count)
    cell_w, cell_h = EXEMPLAR_PX + search_px + 3 * GAP_PX, CAPTION_PX + search_px + GAP_PX
    sheet = np.full((-(-count // columns) * cell_h, columns * cell_w, 3), PAPER_BGR, np.uint8)
    number = 0
    for batch in batches:
        for row in range(len(batch.negative)):
            top, left = number // columns * cell_h, number % columns * cell_w
            _draw(sheet[top : top + cell_h, left : left + cell_w], batch, row, number)
            number += 1
    return sheet


def _draw(cell: ImageU8, batch: Batch, row: int, number: int) -> None:
    exemplar, search = _picture(batch.exemplar[row]), _picture(batch.search[row])
    box = batch.box[row].detach().cpu().numpy().astype(np.float64)
    side = search.shape[0]
    if bool(batch.negative[row]):
        caption = f"{number} negative"
        cv2.rectangle(search, (0, 0), (side - 1, side - 1), NEGATIVE_BGR, NEGATIVE_FRAME_PX)
    else:
        caption = f"{number} x{exemplar_side_px(box[2] - box[0], box[3] - box[1]) / EXEMPLAR_PX:.2f}"
        # The box is in continuous pixels from the crop's centre; pixel u has its centre at u + 0.5.
        x1, y1, x2, y2 = (round(float(v)) for v in box + side / 2 - 0.5)
        cv2.rectangle(search, (x1, y1), (x2, y2), LABEL_BGR, 1)
    cell[CAPTION_PX : CAPTION_PX + EXEMPLAR_PX, GAP_PX : GAP_PX + EXEMPLAR_PX] = exemplar
    left = EXEMPLAR_PX + 2 * GAP_PX
    cell[CAPTION_PX : CAPTION_PX + side, left : left + side] = search
    cv2.putText(cell, caption, (GAP_PX, CAPTION_PX - 4), cv2.FONT_HERSHEY_SIMPLEX, TEXT_SCALE, INK_BGR, 1, cv2.LINE_AA)


def _picture(chw: torch.Tensor) -> ImageU8:
    """(3, S, S) to (S, S, 3), to be drawn on."""
    return np.ascontiguousarray(chw.detach().cpu().numpy().transpose(1, 2, 0))
