"""Where pictures with boxes come from: published data sets, plain folders and tables, packed crops."""

from tracker.training.sources.mix import Mix, open_mix
from tracker.training.sources.opening import open_footage, open_source, reserved_names

__all__ = ["Mix", "open_footage", "open_mix", "open_source", "reserved_names"]
