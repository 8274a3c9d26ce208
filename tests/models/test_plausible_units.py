"""Models in millimetres or grams: notes that name the unit and the body."""

import mujoco
import pytest

import sim
from sim.models.notes import ModelNote

ARM = """<mujoco><worldbody><body name="upper"><joint name="lift" axis="0 1 0"/>
  <inertial mass="{m}" pos="{c} 0 0" diaginertia="{i} {k} {k}"/>
  <body name="fore" pos="{length} 0 0"><joint name="bend" axis="0 1 0"/>
  <inertial mass="{m}" pos="{c} 0 0" diaginertia="{i} {k} {k}"/></body></body></worldbody></mujoco>"""


def arm(*, mass=1.0, length=1.0, inertia=1.0):
    """An arm of two links of 2 kg and 300 mm, with factors on its units."""
    numbers = {"m": 2 * mass, "c": 0.15 * length, "length": 0.3 * length, "i": 0.002 * inertia, "k": 0.016 * inertia}
    return sim.mechanism(mujoco.MjSpec.from_string(ARM.format(**numbers)))


@pytest.mark.parametrize(
    ("factors", "told"),
    [
        ({"length": 1e3}, "'fore' from its parent at 300 m: its lengths may be in mm"),
        ({"inertia": 1e4}, "upper .*, fore .*: their inertias may be in kg cm²"),
        ({"inertia": 1e6}, "upper .*, fore .*: their inertias may be in kg mm²"),
        ({"inertia": 1e7}, "upper .*, fore .*: their inertias may be in g cm²"),
        ({"inertia": 1e9}, "upper .*, fore .*: their inertias may be in g mm²"),
        ({"mass": 1e3}, "upper .*, fore .*: their masses may be in g"),
        ({"mass": 1e3, "inertia": 1e3}, "upper .*, fore .*: their masses may be in g"),
        ({"mass": 1e3, "inertia": 1e9}, "or in g mm² with masses in g"),
    ],
)
def test_a_unit_that_no_material_allows_is_noted_with_the_body(factors, told):
    with pytest.warns(ModelNote, match=told) as notes:
        arm(**factors)
    assert len(notes) == 1
