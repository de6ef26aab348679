"""The numbers of `TargetTracker`, in one place."""

from __future__ import annotations

from dataclasses import dataclass, field

from tracker.association import AssociationConfig
from tracker.filter import check_range
from tracker.status import StatusConfig


@dataclass(frozen=True, slots=True)
class TargetConfig:
    """Thresholds, times and budgets of `TargetTracker`.

    A candidate below `use_confidence` never enters the estimate. What is found again must look like the target: its
    cosine with an exemplar at least `alike_share`, and the similarity of its colours at least `colour_share`, of what
    the target's was in its first confirmed second. A prediction is reported while its 2-sigma ellipse stays within
    `search_half_sizes` target sizes (half the search crop: 287/127 of an exemplar of two sizes). Searches take at most
    `max_calls` network calls per picture. `sure_*`: when the small search crop will do.
    """

    status: StatusConfig = field(default_factory=StatusConfig)
    association: AssociationConfig = field(default_factory=AssociationConfig)
    use_confidence: float = 0.25
    alike_share: float = 0.7
    found_share: float = 0.8
    # On the validation sequences 3 % of the boxes on the target were below it, 67 % of those off it.
    sustain_share: float = 0.5
    present_share: float = 0.8
    # Half a second to eight seconds later 98 % of targets reach it (529 looks in 30 training videos; 99 % of 998 in
    # simulated flights) with exposure varied by 12 % and tint by 4 %; without memory 96 % and 99 %. Of simulated cars
    # in other paints 86 % do not; silver and pale blue are not told apart. At 0.80: 97 % and 99 % against 90 %.
    colour_share: float = 0.76
    search_half_sizes: float = 2.26
    max_calls: int = 2
    sure_confidence: float = 0.85
    sure_sizes_s: float = 0.7

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError naming field, value and range."""
        for name, low, high in (
            ("use_confidence", 0.0, self.status.drop_confidence),
            ("alike_share", 0.0, 1.0),
            ("found_share", self.alike_share, 1.0),
            ("sustain_share", 0.0, self.alike_share),
            ("present_share", 0.0, 1.0),
            ("colour_share", 0.0, 1.0),
            ("search_half_sizes", 0.5, 50.0),
            ("max_calls", 1, 16),
            ("sure_confidence", 0.0, 1.0),
            ("sure_sizes_s", 0.0, 100.0),
        ):
            check_range("target", name, getattr(self, name), low, high)
