"""Findings and verdicts of identifications from short simulated recordings."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from coded import coded
from mechanisms import sines
from recorded_faults import PENDULUM, angles_and_wrench, estimated

import ident
from ident.judgement.checks import FrameCheck
from ident.judgement.finding import Finding
from ident.judgement.verdict import Outcome, Verdict, decided
from ident.setup import PRIORS
from ident.tolerances import NOTABLY


def swung(seed, seconds=5.0, rate=100, size=0.4, drag=0.0):
    """The pendulum in a motion of six sines, with noise and a drag along y that no model has (N s²)."""
    rng, time = np.random.default_rng(seed), np.arange(0, seconds, 1 / rate)
    w, a = 2 * np.pi * rng.uniform(0.2, 1.2, (2, 3)), size * rng.uniform(0.1, 0.5, (2, 3))
    q, dq, ddq = sines(time, a, w, rng.uniform(0, 6, (2, 3)))
    wrench = ident.base_wrench_regressor(PENDULUM.tree, q, dq, ddq, gravity=PENDULUM.gravity) @ PENDULUM.known
    wrench[:, 1] += drag * dq[:, 0] * np.abs(dq[:, 0])
    wrench += rng.normal(size=wrench.shape) * np.repeat([0.1, 0.01], 3)
    return angles_and_wrench(time, q + 0.001 * rng.normal(size=q.shape), wrench)


@pytest.mark.slow
def test_a_right_model_s_residuals_do_not_go_with_the_motion_of_another_log():
    """Errors of a motion smoothed from its angles alone correlate with it, but a fit's own residuals do not."""
    estimate = ident.identify(PENDULUM, swung(15, rate=500), held_out=swung(1015, rate=500))
    assert (estimate.held_out.ratio[1:] > 0.01).any() and not coded(estimate, "residual_follows_motion")


def test_a_wrong_model_s_residuals_do():
    recording, other = (swung(seed, seconds=20, rate=50, size=1, drag=10.0) for seed in (1, 1001))
    estimate = ident.identify(PENDULUM, recording, held_out=other, setup=dict.fromkeys(PRIORS, 0.0))
    (finding,) = coded(estimate, "residual_follows_motion")
    assert finding.doubt and "Fy" in finding.place.channels


@pytest.fixture
def estimate():
    return estimated()


def with_ratios(estimate, **rivals):
    """An estimate beside rivals with residuals of Fy, Fz, Mx, My, Mz larger by these factors."""
    names = {"model": "model", "squares": "least squares"}
    own = np.maximum(estimate.held_out.ratio, 0.1)
    residual = estimate.held_out.residual * own / estimate.held_out.ratio
    rivals = {names[key]: residual * np.append(1, factors) for key, factors in rivals.items()}
    other = replace(estimate, held_out=replace(estimate.held_out, residual=residual, rivals=rivals), filtered_at=3.21)
    vars(other)["model_error"] = np.zeros(6)
    return other


def test_worse_than_another_is_the_first_sentence_a_doubt_and_says_what_to_take(estimate):
    other = with_ratios(estimate, model=[2, 2, 2, 2, 2], squares=[0.5, 0.9, 0.6, 1, 1])
    verdict, doubt = other.verdict(), other.findings[0]
    assert verdict.outcome is Outcome.NOT and verdict.doubts == ("worse_than_candidate",)
    assert verdict.best == "least squares" and verdict.worse is doubt and str(verdict).startswith(doubt.text)
    assert doubt.doubt and doubt.place.channels == ("Fy", "Mx")
    assert doubt.values["worse"]["least squares"].keys() == {"Fy", "Mx"}
    assert doubt.values["take"] == "least squares" and doubt.values["cutoff_hz"] == 3.21
    pairs = verdict.candidates.pairs("least squares").items()
    assert [channel for channel, (own, other) in pairs if own > NOTABLY * other] == ["Fy", "Fz", "Mx"]
    other = with_ratios(estimate, model=[0.5, 0.9, 0.6, 1, 1], squares=[1, 1, 1, 0.6, 1])
    doubt = other.verdict().worse
    worse = {name: set(pairs) for name, pairs in doubt.values["worse"].items()}
    assert worse == {"least squares": {"My"}, "model": {"Fy", "Mx"}}
    assert doubt.values["take"] == "model"


def test_a_wrong_sign_comes_before_what_it_does_to_the_estimate_and_leaves_no_candidate_to_take(estimate):
    other = with_ratios(estimate, model=[2, 2, 2, 2, 2], squares=[0.5, 0.9, 0.6, 1, 1])
    flipped = FrameCheck(-1, np.eye(3), 2.0, 0.01)
    vars(other)["checks"] = other.checks._replace(frames={"ground": flipped})
    verdict, (cause, effect, *_) = other.verdict(), other.findings
    assert verdict.doubts[:2] == (cause.code, effect.code) == ("wrench_sign_or_axes", "worse_than_candidate")
    assert effect.text.endswith("First mend the recording, as said above.")
    assert "Worse" not in str(verdict) and "--estimator" not in str(verdict)
    other = with_ratios(estimate, model=[2, 2, 2, 2, 2], squares=[0.9, 0.9, 0.95, 0.9, 1.02])
    vars(other)["checks"] = other.checks._replace(frames={"ground": flipped})
    assert other.verdict().worse is None


def test_candidates_are_compared_where_a_doubt_stands_and_where_none_predicts(estimate):
    doubted = with_ratios(estimate, model=[2, 2, 2, 2, 2], squares=[1, 1, 1, 1, 1])
    verdict = Verdict.of(doubted, [Finding.of("weight_drifts", drift=2.0)])
    assert verdict.outcome is Outcome.NOT and verdict.doubts == ("weight_drifts",) and verdict.best == "estimate"
    assert verdict.brief == "One finding speaks against it; it predicts all 5 channels that count."
    residual = estimate.held_out.residual * 1e6
    rivals = {"model": 9 * residual, "least squares": 8 * residual}
    nothing = replace(estimate, held_out=replace(estimate.held_out, residual=residual, rivals=rivals))
    verdict = Verdict.of(nothing, [])
    assert verdict.outcome is Outcome.NOT and verdict.best is None and not verdict.predicted
    assert str(verdict).startswith("Not usable: it predicts none of 6 channels (held-out).")
    assert "No candidate explains any channel, so that none is best." in str(verdict)


@pytest.mark.parametrize(
    ("ratios", "outcome", "predicted"),
    [
        ([0.1], Outcome.USABLE, 6),
        ([0.1, 0.8], Outcome.USABLE, 5),
        ([0.1, 0.95], Outcome.PARTLY, 5),
        ([0.1, 0.6, 0.6], Outcome.PARTLY, 4),
        ([0.1, 0.95, 0.95, 0.95, 0.95, 0.95], Outcome.PARTLY, 1),
        ([0.95, 0.95, 0.95, 0.95, 0.95, 0.95], Outcome.NOT, 0),
    ],
)
def test_a_verdict_counts_all_channels_that_move(estimate, ratios, outcome, predicted):
    """Three quarters are predicted, and none is unexplained."""
    every = dict(zip(estimate.channels, [*ratios, *(6 - len(ratios)) * [0.1]], strict=True))
    judged = replace(estimate)
    vars(judged).update(ratios=every, idle={})
    verdict = Verdict.of(judged, [])
    assert verdict.outcome is outcome and len(verdict.predicted) == predicted and len(verdict.counted) == 6
    assert set(verdict.missed) == set(verdict.ratios) - set(verdict.predicted) and not verdict.idle
    shown = verdict.to_dict()
    assert shown["channels"]["predicted"] == list(verdict.predicted) and shown["outcome"] == outcome.value
    words = {"usable": "to predict wrenches", "partly": f"usable: it predicts {verdict.channels}"}
    assert words.get(outcome.value, "usable: it predicts none of 6 channels") in str(verdict)
    assert str(verdict) == shown["verdict"] == repr(verdict)
    assert len(verdict.brief.split()) <= 20


@pytest.mark.parametrize(
    ("missed", "words"),
    [
        ([], "all 12 channels"),
        ([5], "all channels but wrist5"),
        (range(4), "all channels but wrist0, wrist1, wrist2, wrist3"),
        (range(5), "7 of 12 channels"),
        (range(9), "wrist9, wrist10, wrist11"),
    ],
)
def test_channels_are_named_where_they_are_fewer_than_five(estimate, missed, words):
    ratios = {f"wrist{k}": 0.9 if k in missed else 0.1 for k in range(12)}
    verdict = replace(estimate.verdict(), outcome=decided(ratios.values(), ()), ratios=ratios, idle={})
    assert verdict.channels == words and words in str(verdict) and words in verdict.brief
    poor = replace(verdict.precision, known=(0, 0, 0))
    for outcome, doubts in product(Outcome, ([], ["unmodelled"], ["unmodelled"] * 11)):
        other = replace(verdict, outcome=outcome, doubts=tuple(doubts), idle={"base": "still"}, precision=poor)
        assert len(other.brief.split()) <= 20, other.brief


@pytest.mark.parametrize(
    ("name", "own", "other"), [("least squares", "squares", "model"), ("model", "model", "squares")]
)
def test_a_candidate_that_is_better_in_the_median_channel_is_the_first_sentence(estimate, name, own, other):
    def verdict(*better):
        return with_ratios(estimate, **{own: better, other: [2, 2, 2, 2, 2]}).verdict()

    best = verdict(0.9, 0.9, 0.95, 0.9, 1.02)
    assert best.usable and best.best == name and best.worse.code == "candidate_better"
    assert best.worse.values["candidate"] == name and not best.worse.doubt
    assert best.worse.values["behind"] == pytest.approx(1 / 0.9)
    assert str(best).startswith(best.worse.text) and "in the median of 5 channels" in best.worse.text
    assert "Over all channels the estimate" not in str(best)
    # Hardly better, and better in the median channel but far worse in one.
    for better in ([0.96, 0.96, 0.96, 0.96, 0.96], [0.9, 0.9, 0.9, 0.9, 3]):
        little = verdict(*better)
        assert little.worse is None and little.best == "estimate"
