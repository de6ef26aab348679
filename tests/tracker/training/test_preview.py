"""The contact sheet shows every pair, its label where it is, and which pairs have no target."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tracker.training.preview import CAPTION_PX, GAP_PX, LABEL_BGR, NEGATIVE_BGR, contact_sheet
from tracker.training.types import Batch, Skipped

S = 223
CELL_W, CELL_H = 127 + S + 3 * GAP_PX, CAPTION_PX + S + GAP_PX


def _batch(rows: int, search_px: int = S, negative: tuple[int, ...] = ()) -> Batch:
    exemplar = torch.arange(rows, dtype=torch.uint8)[:, None, None, None].expand(rows, 3, 127, 127).contiguous() + 100
    search = torch.full((rows, 3, search_px, search_px), 60, dtype=torch.uint8)
    box = torch.tensor([[-20.5, -10.5, 39.5, 29.5]]).repeat(rows, 1)
    return Batch(exemplar, search, box, torch.tensor([r in negative for r in range(rows)]), Skipped())


def _cell(sheet: np.ndarray, number: int, columns: int) -> np.ndarray:
    top, left = number // columns * CELL_H, number % columns * CELL_W
    return sheet[top : top + CELL_H, left : left + CELL_W]


def _found(picture: np.ndarray, colour: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    return np.nonzero((picture == np.array(colour, np.uint8)).all(axis=2))


def test_every_pair_has_its_cell() -> None:
    sheet = contact_sheet(_batch(5), columns=3)
    assert sheet.shape == (2 * CELL_H, 3 * CELL_W, 3)
    for number in range(5):
        cell = _cell(sheet, number, 3)
        assert (cell[CAPTION_PX : CAPTION_PX + 127, GAP_PX : GAP_PX + 127] == 100 + number).all()
    assert len(np.unique(_cell(sheet, 5, 3))) == 1


def test_the_box_is_drawn_where_the_label_is() -> None:
    search = _cell(contact_sheet(_batch(1)), 0, 1)[CAPTION_PX : CAPTION_PX + S, 127 + 2 * GAP_PX : 127 + 2 * GAP_PX + S]
    y, x = _found(search, LABEL_BGR)
    middle = S // 2  # the pixel whose centre is the crop's centre
    # A label's edge lies between two pixels; the line runs on one of them.
    assert (x.min() - middle, y.min() - middle) == pytest.approx((-20.5, -10.5), abs=0.6)
    assert (x.max() - middle, y.max() - middle) == pytest.approx((39.5, 29.5), abs=0.6)


def test_negatives_have_a_red_frame_and_no_box() -> None:
    sheet = contact_sheet(_batch(2, negative=(1,)), columns=2)
    positive, negative = (_cell(sheet, n, 2) for n in (0, 1))
    assert len(_found(positive, NEGATIVE_BGR)[0]) == 0
    assert len(_found(negative, LABEL_BGR)[0]) == 0
    assert len(_found(negative, NEGATIVE_BGR)[0]) > 4 * S


def test_captions_tell_the_size_ratio() -> None:
    small, large = _batch(1), _batch(1)
    large.box.mul_(1.5)
    captions = [contact_sheet(b)[: CAPTION_PX - 1] for b in (small, large)]
    assert not np.array_equal(*captions)
    assert all((c.max(axis=2) > 150).sum() > 20 for c in captions)


def test_several_batches_make_one_sheet() -> None:
    sheet = contact_sheet([_batch(2), _batch(1)], columns=2)
    assert sheet.shape[0] == 2 * CELL_H
    assert _cell(sheet, 2, 2)[CAPTION_PX, GAP_PX, 0] == 100


def test_batches_are_left_alone() -> None:
    batch = _batch(2, negative=(0,))
    contact_sheet(batch)
    assert (batch.search == 60).all()


@pytest.mark.parametrize(
    ("batches", "columns"),
    [([], 8), ([_batch(1), _batch(1, 287)], 8), ([_batch(1)], 0)],
    ids=["none", "sizes", "columns"],
)
def test_what_cannot_be_drawn_is_said(batches: list[Batch], columns: int) -> None:
    with pytest.raises(ValueError, match="contact sheet of"):
        contact_sheet(batches, columns)
