"""Findings on residuals, convergence and joint ranges: their thresholds, and those of doubts."""

from types import SimpleNamespace

import pytest

from ident.judgement.finding import SetupFinding
from ident.judgement.fit_findings import course_findings, quality_findings
from ident.judgement.setup_findings import setup_remarks


def joint(**fit):
    return SimpleNamespace(trajectory=SimpleNamespace(fit=SimpleNamespace(**fit)))


def judged_by(judge, **evidence):
    return list(judge(SimpleNamespace(**evidence)))


@pytest.mark.parametrize(
    ("status", "steps", "doubted"),
    [
        ("converged", [5.0, 0.01], False),
        ("converged", [5.0, 0.5], False),
        ("rounds", [5.0, 0.25], False),
        ("rounds", [5.0, 0.35], True),
        ("stuck", [0.35], True),
        ("interrupted", [5.0, 1.0, 0.01], True),
    ],
)
def test_an_estimate_that_did_not_settle_is_a_doubt(status, steps, doubted):
    findings = list(course_findings(joint(status=status, trace=steps)))
    assert [(finding.code, finding.doubt) for finding in findings] == [("not_converged", True)] * doubted
    assert not findings or findings[0].values == {"status": status, "rounds": len(steps)}


LATE = {"of": "ground", "axis": None, "value": 0.02, "std": 0.001}


@pytest.mark.parametrize("setup", [(), (SetupFinding("delay(ground)", 0.02, 0.001, "delay", LATE, ()),)])
def test_a_set_up_that_explains_nothing_is_a_doubt_beside_what_was_found(setup):
    search = SimpleNamespace(incredible=True)
    *remarks, doubt = setup_remarks(SimpleNamespace(setup=setup, trajectory=SimpleNamespace(search=search)))
    assert [(finding.code, finding.doubt) for finding in remarks] == [("setup_delay", False)] * len(setup)
    assert (doubt.code, doubt.doubt, doubt.values) == ("setup_unexplained", True, {"changed": bool(setup)})


def test_residuals_over_signals_are_sorted_by_what_they_mean():
    ratios = {"a": 0.2, "b": 0.6, "c": 0.97, "d": 1.7, "e": 0.61}
    frames = {"ground": SimpleNamespace(mirrored=("f",))}
    given = {"ratios": ratios | {"f": 2.0, "g": 2.0}, "checks": SimpleNamespace(frames=frames), "idle": {"g": "noise"}}
    findings = judged_by(quality_findings, held_out=SimpleNamespace(part="held-out"), **given)
    assert [(finding.code, finding.doubt, finding.place.channels) for finding in findings] == [
        ("residual_above_signal", True, ("d",)),
        ("unexplained_channels", False, ("c",)),
        ("poor_prediction", False, ("b", "e")),
    ]
    assert findings[2].values == {"ratios": {"b": 0.6, "e": 0.61}, "part": "held-out"}
