"""What is wrong with a view: the picture cannot be read, or its box cannot be used."""

from __future__ import annotations

UNREADABLE = "unreadable picture"
UNUSABLE = "box that cannot be used"


class UnusableBox(str):
    """Why a view cannot be had although its picture can be read; told from other faults by its type."""

    __slots__ = ()


def kind_of(fault: str) -> str:
    """What a fault of `Source.view` is counted as."""
    return UNUSABLE if isinstance(fault, UnusableBox) else UNREADABLE
