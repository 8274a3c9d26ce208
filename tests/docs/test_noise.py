"""The study of noisy joint sensors: its recordings, the other methods' formulas, and the trajectory estimate."""

from dataclasses import replace

import numpy as np
import pytest
from commands import entries_of, rows_of

from docs.tools import noise
from docs.tools.noise import ESTIMATORS, Case
from docs.tools.noise_conditions import CONDITIONS, SUBJECTS

PERSON, PENDULUM = SUBJECTS["person"], SUBJECTS["pendulum"]
IXX2 = PERSON.parameters.names.index("Ixx2")


@pytest.mark.slow
def test_the_trajectory_estimate_is_right_where_least_squares_is_off_by_several_of_its_own():
    cases = [Case.drawn(CONDITIONS["pendulum_x3"], 0, number) for number in range(4)]
    for estimator, low, high in (("ordinary", -np.inf, -5), ("trajectory", -0.5, 0.5)):
        answers = [ESTIMATORS["pendulum"][estimator](case) for case in cases]
        assert low < np.mean([((each.values - each.true) / each.std)[IXX2] for each in answers]) < high


KINDS = (
    *("commands_trapezoids_plate", "rubs_trapezoids_100", "payload_gains", "torques_and_wrench", "flicker", "student"),
    *("quantised", "bodies_drawn", "pendulum_ar80", "pendulum_missing", "pendulum_outliers"),
)


@pytest.mark.parametrize("name", KINDS)
def test_a_recording_is_drawn_by_its_number(name):
    condition = replace(CONDITIONS[name], samples=150)
    case, again, other = (Case.drawn(condition, 0, number) for number in (0, 0, 1))
    assert case.recording.time.size <= 150 and case.drives == other.drives
    for channel, values in case.recording.measured.items():
        np.testing.assert_array_equal(values, again.recording[channel])
        assert values.shape != other.recording[channel].shape or (values != other.recording[channel]).any()
    assert (case.phi == other.phi).all() != condition.drawn
    assert bool(case.recording.setup or case.recording.scales) == bool(condition.gain)


@pytest.fixture
def short(monkeypatch):
    """Replaces the trajectory estimate by quick estimators: half a minute of work in a second."""
    some = {name: CONDITIONS[name] for name in ("pendulum_x1", "pendulum_x3", "person_half_degree")}
    pendulum, person = ESTIMATORS["pendulum"], ESTIMATORS["person"]["usual_filter"]
    cheap = {"ordinary": pendulum["ordinary"], "trajectory": pendulum["instruments"]}
    monkeypatch.setattr(noise, "CONDITIONS", some)
    monkeypatch.setattr(
        noise, "ESTIMATORS", {"pendulum": cheap, "person": dict.fromkeys(("usual_filter", "trajectory"), person)}
    )


@pytest.mark.usefixtures("short", "here")
def test_the_command_writes_tables(tmp_path):
    assert noise.main(["--out", str(tmp_path), "--recordings", "3"]) == 0
    rows = [row for row in rows_of(tmp_path / "table_coverage.csv") if row["subject"] == "pendulum"]
    assert list(dict.fromkeys((row["noise"], row["estimator"]) for row in rows)) == [
        (f"noise ×{k}", label) for k in (1, 3) for label in ("ordinary least squares", "trajectory estimate")
    ]
    rows = rows_of(tmp_path / "table_parameters.csv")
    row = next(each for each in rows if (each["noise"], each["parameter"]) == ("noise ×3", "Ixx2"))
    assert float(row["true"]) == pytest.approx(PENDULUM.true[IXX2]) and float(row["bias"]) < -0.1
    assert entries_of(tmp_path / "provenance.json")["options"]["recordings"] == 3
