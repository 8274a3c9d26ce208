"""A person on a chair or leaning on a table without sensors: the whole command reports it."""

import json

import numpy as np
import pytest
from fuzz.undrawn import leave_undrawn

import scenes
import sim
from experiments import identify
from experiments.data.person import Laboratory
from experiments.studies.person_recordings import mistaken, sensed
from sim.models.model_update import write_model
from sim.motion import person

pytestmark = pytest.mark.slow

STIFF = ("neck", "pronation", "wrist", "toes", "thoracic")
LABORATORY = Laboratory(rate=50, rail=False)
TIME = LABORATORY.times(2.5)


def chair(time, height):
    """Share of the weight on the chair at this height of the point (N,)."""
    return 0.5 * np.clip((height.min() + 0.08 - height) / 0.05, 0, 1)


def table(time, height):
    """Share of the weight on a hand on the table from 1 to 2 s (N,)."""
    return 0.2 * np.clip(np.minimum(time - 1, 2 - time) / 0.1, 0, 1)


def nothing(time, height):
    """No share of the weight (N,)."""
    return 0 * time


def supported(who, activity, seed, carries=nothing, body="pelvis", point=(0, 0, 0)):
    """A recording of a person who rests on something, and the share of the weight on it.

    Args:
        who: The person.
        activity: Her activity.
        seed: Seed of the motion and the noise.
        carries: Share of the weight by time and height of the point.
        body: Body that rests on it.
        point: Point in that body's frame, m.
    """
    style = person.Style(rail=False, seed=seed)
    motions = [person.motion(who.tree, activity, time, style) for time in (TIME, TIME - LABORATORY.late)]
    poses = motions[1].base.T @ who.tree.poses(motions[1].q)[:, who.tree.names.index(body)]
    at = (poses @ [*point, 1])[:, :3]
    share = carries(TIME, at[:, 2])
    force = 9.81 * who.mass * share[:, None] * [0.04, 0.02, 1]
    felt = np.hstack([force, np.cross(at, force)])
    return sensed(who, TIME, motions, LABORATORY, np.random.default_rng(seed), felt), share


@pytest.fixture(scope="module")
def supported_person(tmp_path_factory):
    """The command's result for one who sits down, leans, and swings the arms; the truth; and the shares (N,)."""
    folder, spec = tmp_path_factory.mktemp("supported"), scenes.load("humanoid")
    for joint in [joint for joint in spec.joints if any(word in joint.name for word in STIFF)]:
        spec.delete(joint)
    true = sim.mechanism(spec, base="pelvis")
    write_model(folder / "known.xml", true, mistaken(true, np.random.default_rng(2), 0.1).known)
    sits, seated = supported(true, "squats", 4, chair, "pelvis", (-0.05, 0, -0.1))
    leans, leant = supported(true, "swaying", 1, table, "left_hand", (0, 0, -0.06))
    recordings = {"sits": sits, "leans": leans, "swings": supported(true, "arm swings", 2)[0]}
    for name, recording in recordings.items():
        recording.save(folder / f"{name}.npz")
    logs = [str(folder / f"{name}.npz") for name in recordings]
    command = [str(folder / "known.xml"), *logs, "--base", "pelvis", "--prior", "on", "--workers", "1"]
    with pytest.MonkeyPatch.context() as patch:
        leave_undrawn(patch)
        assert identify.main([*command, "--out", str(folder), "--name", "out"]) == 0
    return json.loads((folder / "out" / "estimate.json").read_text(encoding="utf-8")), true, (seated, leant)


def test_who_rests_on_what_and_how_much_it_takes_is_said(supported_person):
    contacts = [each["values"] for each in supported_person[0]["findings"] if each["code"] == "unmeasured_contact"]
    spans = [(each["start"], each["end"], each["carries"], each["body"]) for each in contacts]
    seated, leant = supported_person[2]
    on_chair = [span for span in spans if span[3] in ("pelvis", "left_thigh", "right_thigh")]
    on_table = [span for span in spans if span[3] in ("left_hand", "left_forearm")]
    assert len(on_chair) + len(on_table) == len(spans) and len(on_table) == 1
    for there, share, few in ((on_chair, seated, 0.5), (on_table, leant, 1.0)):
        outside = np.all([(a > TIME) | (b < TIME) for a, b, *_ in there], axis=0)
        assert not (outside & (share > 0.03)).any()
        assert outside.mean() > 0.3 * few
        np.testing.assert_allclose(max(c for _, _, c, _ in there), share.max(), atol=0.08)


def test_the_samples_without_them_tell_who_it_is(supported_person):
    """A fifth of the weight on a table would make her lighter, and a chair by more."""
    mass = sum(body["m"] for body in supported_person[0]["bodies"].values())
    assert mass == pytest.approx(supported_person[1].mass, rel=0.01)
    assert supported_person[0]["outcome"] == "usable"
    (late,) = supported_person[0]["setup"]
    assert late["name"].startswith("delay") and abs(late["value"] - LABORATORY.late) < 3 * late["std"]
