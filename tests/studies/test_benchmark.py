"""The benchmark runs and compares equal results; its claims without a clock hold. No time is asserted."""

import sys

import numpy as np
import pytest
from commands import refusal

from experiments.benchmark import identification, monte_carlo, peers, sections, tables, timing
from experiments.benchmark.__main__ import main
from experiments.benchmark.mechanisms import chain, double_pendulum, humanoid, in_general_position, mechanisms
from ident.parameters.base_parameters import STANDARD_GRAVITY


@pytest.mark.parametrize(("numpy", "shown"), [(2e-3, "20.0 (10.0) of 20 µs"), (None, "20.0 of 20 µs")])
def test_what_the_peer_takes_stands_beside_each_ratio(numpy, shown):
    task = next(iter(identification.TASKS))
    row = {"task": task, "mechanism": "tree", "bodies": 8, "samples": 1000, "ours": 1e-3, "theirs": 2e-2, "ratio": 20.0}
    table = tables.table_overview({"comparisons": [row | {"numpy": numpy}]})
    assert table.rows[0][:4] == ("tree", "8", "1,000", shown)


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_measured(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sections, "measured", lambda effort: pytest.fail("measured first"))
    (tmp_path / "file").touch()
    assert "needs to be a writable folder" in refusal(main, ["--out", str(tmp_path / "file")], capsys)


def test_a_missing_peer_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    (missing,) = peers.missing()
    assert "'pinocchio'" in missing
    assert ".[peers]" in missing


def test_ways_take_turns():
    calls = []
    times = timing.alternating([lambda: calls.append("a"), lambda: calls.append("b")], seconds=0, least=3)
    assert "".join(calls) == "ab" * 4
    assert times.shape == (3, 2)
    assert (times >= 0).all()


def test_ratio_is_that_of_the_medians():
    assert timing.ratio(np.array([[1.0, 4], [2, 6], [10, 10]])) == (3, 1, 4)


@pytest.mark.extras
@pytest.mark.parametrize("mechanism", mechanisms(), ids=lambda mechanism: mechanism.name)
def test_peers_have_the_same_regressor(mechanism):
    pytest.importorskip("pinocchio", reason="Pinocchio is in the extra 'peers'")
    samples = mechanism.samples(20)
    other = peers.Pinocchio(mechanism.tree, STANDARD_GRAVITY)
    Y = other.regressor(*other.states(samples.motion.states, samples.motion.base))
    own = mechanism.regressor(samples)
    np.testing.assert_allclose(Y[..., other.columns(range(own.shape[2]))], own, rtol=0, atol=1e-12 * abs(own).max())


def test_what_differs_is_not_timed():
    with pytest.raises(ValueError, match=r"arms: results differ by 5\.0e-01"):
        identification.check_agreement("arms", np.array([1.0, 2.0]), np.array([1.0, 4.0]))
    with pytest.raises(ValueError, match="nan"):
        identification.check_agreement("arms", np.array([np.nan]), np.array([1.0]))


def test_mechanisms_are_what_their_names_say():
    assert [(m.name, len(m.tree.bodies)) for m in mechanisms()[::2]] == [
        ("double pendulum", 3),
        ("7-link arm", 8),
        ("30-body tree", 30),
    ]
    parents = [body.parent for body in humanoid().bodies]
    # Depth first: a body follows its parent, or a limb that is finished.
    assert all(parent == i - 1 or i - 1 not in parents for i, parent in enumerate(parents) if i)
    assert parents.count(0) == parents.count(15) == 3
    axes = [body.twist[3:] for body in in_general_position(chain(8)).bodies[1:]]
    assert (np.abs(axes) > 1e-3).all()


def test_pieces_are_all_samples_and_differ():
    sizes, first = zip(*((len(piece), piece.motion.q[0, 0]) for piece in double_pendulum().pieces(25, 10)), strict=True)
    assert sizes == (10, 10, 5)
    assert len(set(first)) == 3


def test_trials_draw_their_own_noise_around_one_truth():
    trials = monte_carlo.Trials.of(400)
    drawn = [trials.drawn(seed) for seed in range(50)]
    assert np.array_equal(drawn[3].measured, trials.drawn(3).measured)
    for k, level in enumerate(trials.noise):
        x, *noisy = ((*samples.motion.states, samples.measured)[k] for samples in (trials.true, *drawn))
        errors = np.array(noisy) - x
        np.testing.assert_allclose(errors.std(axis=(0, 1)), level, rtol=0.05)
