"""The regression of the confidence on made-up samples whose law is known."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.confidence.features import FEATURES, Doubt
from tracker.confidence.model import ConfidenceModel
from tracker.messages import Array
from tracker.training.confidence.fit import cross_validate, fit, fitted, held_out, probabilities
from tracker.training.confidence.samples import Sample, SampleKind, Table
from tracker.training.errors import TrainingError

NAMES = ("margin", "exemplar", "nis", "head_1")
COLUMN = {name: FEATURES.index(name) for name in FEATURES}


def law(values: Array) -> float:
    """The probability that the samples are drawn by: margin for, nis against, head_1 without a say."""
    return float(1 / (1 + np.exp(-(0.5 + 1.5 * values[COLUMN["margin"]] - 2.0 * values[COLUMN["nis"]]))))


def table(count: int = 1500, names: tuple[str, ...] = ("a", "b", "c"), seed: int = 0) -> Table:
    rng = np.random.default_rng(seed)
    samples = []
    for k in range(count):
        values = np.zeros(len(FEATURES))
        values[[COLUMN[name] for name in NAMES]] = rng.normal(size=len(NAMES))
        values[COLUMN["has_motion"]] = values[COLUMN["has_exemplar"]] = 1.0
        kind = SampleKind.ABSENT if k % 5 == 0 else SampleKind.TRACK
        samples.append(Sample(names[k % len(names)], kind, values, rng.uniform(), bool(rng.uniform() < law(values))))
    return Table.of(samples)


def weight(model: ConfidenceModel, name: str) -> float:
    return model.weights[model.names.index(name)] / model.scale[model.names.index(name)]


def test_the_law_is_found() -> None:
    model = fit(table(6000), NAMES, l2=1e-6)
    assert weight(model, "margin") == pytest.approx(1.5, abs=0.15)
    assert weight(model, "nis") == pytest.approx(-2.0, abs=0.2)
    assert weight(model, "head_1") == pytest.approx(0.0, abs=0.1)


def test_a_weight_has_the_sign_that_its_feature_can_only_have() -> None:
    """Turned round, a margin would speak against and an innovation for the target: both get no weight."""
    honest = table()
    turned = Table(honest.features, honest.score, ~honest.on_target, honest.probe, honest.sequence, honest.weight)
    model = fit(turned)
    assert all(w >= 0 for n, w in zip(model.names, model.weights, strict=True) if n in ("margin", "head_1", "exemplar"))
    assert weight(model, "nis") == weight(model, "margin") == 0.0


def test_a_feature_that_never_changed_or_was_not_measured_has_no_weight() -> None:
    some = table(300)
    some.features[:, COLUMN["head_2"]] = 3.0
    some.features[:, COLUMN["recent"]] = 0.5
    model = fit(some)
    assert weight(model, "head_2") == weight(model, "recent") == 0.0
    assert model.scale[model.names.index("head_2")] == 1.0


def test_the_mean_is_that_of_what_was_measured() -> None:
    some = table(300)
    some.features[:, COLUMN["exemplar"]] = 0.8
    some.features[::2, COLUMN["exemplar"]] = 0.5
    some.features[::2, COLUMN["has_exemplar"]] = 0.0
    model = fit(some)
    assert model.mean[model.names.index("exemplar")] == pytest.approx(0.8)


def test_more_weight_counts_more() -> None:
    """Sequence `b` has ten times the samples and the same weight."""
    values = np.zeros(len(FEATURES))
    one = [Sample("a", SampleKind.TRACK, values, 0.5, k < 8) for k in range(10)]
    many = [Sample("b", SampleKind.TRACK, values, 0.5, k < 20) for k in range(100)]
    both = Table.of(one + many)
    assert probabilities(fit(both), both) == pytest.approx(0.5, abs=1e-3)


def test_by_appearance_alone_it_is_a_probability_too() -> None:
    """The law averaged over the motion: less sure, but neither too high nor too low."""
    some = table(6000)
    said = probabilities(fit(some, NAMES), some.without_motion())
    assert said.mean() == pytest.approx(some.on_target.mean(), abs=0.03)
    high = said > 0.7
    assert some.on_target[high].mean() == pytest.approx(said[high].mean(), abs=0.06)
    assert some.without_motion().features[:, COLUMN["nis"]].any() == False  # noqa: E712
    assert some.features[:, COLUMN["nis"]].any()


def test_probabilities_agree_with_the_model_in_flight() -> None:
    from tests.tracker.confidence.candidates import candidate
    from tracker.confidence.features import Motion, features

    model = fit(table())
    for motion in (None, Motion(2.0, 0.4, 0.1)):
        found = candidate(second=0.6, exemplar=None)
        rows = Table.of([Sample("a", SampleKind.TRACK, features(found, motion, None), 0.5, True)])
        assert probabilities(model, rows)[0] == pytest.approx(model.probability(found, motion, None))


def test_a_sequence_is_judged_by_the_others_only() -> None:
    """The labels of `c` are turned round: the model of the other is surely wrong, one of both would know nothing."""
    some = table(names=("a", "c"))
    turned = some.rows_of(["c"])
    some.on_target[turned] = ~some.on_target[turned]
    said = held_out(some, ["c"])
    assert np.isnan(said[~turned]).all()
    assert np.corrcoef(said[turned], some.on_target[turned])[0, 1] < -0.3
    assert said[turned].std() > 0.2


def test_figures_of_held_out_sequences_and_what_carries_them() -> None:
    result = fitted(table(), ["a", "b"])
    found = result.cross_validated
    assert found.track.roc_auc is not None
    assert found.score.roc_auc is not None
    assert found.track.roc_auc > 0.85
    assert abs(found.score.roc_auc - 0.5) < 0.06, "the score was drawn at random"
    assert found.track.ece is not None
    assert found.track.ece < 0.08
    assert found.track.frames == 800
    assert found.all.frames == 1000
    without = {doubt: auc or 0.0 for doubt, auc in found.without.items()}
    assert without[Doubt.INNOVATION_GATE] < found.track.roc_auc - 0.1
    assert without[Doubt.LOW_PEAK] == pytest.approx(found.track.roc_auc, abs=0.01)
    assert result.sequences == ("a", "b", "c")


def test_the_block_of_a_card_is_read_back() -> None:
    result = fitted(table(400), ["a", "b", "c"])
    block = result.to_card()
    assert ConfidenceModel.from_card(block) == result.model
    assert block["fit"]["sequences"] == ["a", "b", "c"]
    assert block["fit"]["samples"] == 400
    assert set(block["fit"]["roc_auc_without"]) == {doubt.value for doubt in Doubt}


def test_samples_of_one_kind_or_one_sequence_are_refused() -> None:
    some = table(60)
    with pytest.raises(TrainingError, match="both kinds are needed"):
        fit(some.only(some.on_target))
    with pytest.raises(TrainingError, match="both kinds are needed"):
        fit(Table.of([]))
    with pytest.raises(TrainingError, match="one sequence with samples"):
        cross_validate(some.only(some.rows_of(["a"])), ["a"])
