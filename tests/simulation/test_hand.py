import mujoco
import numpy as np

from sim.simulation.servos import Hand

TIME = np.linspace(-1, 9, 50)


def held():
    rng = np.random.default_rng(0)
    quaternion = rng.normal(size=(len(TIME), 4))
    return rng.normal(size=(len(TIME), 3)), quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)


def test_a_hand_turns_about_the_axes_of_what_it_holds():
    position, quaternion = held()
    hand = Hand(turn=(0.3, 0.2, 0.1))
    _, turned = hand.poses(TIME, position, quaternion)
    for t, start, end in zip(TIME, quaternion, turned, strict=True):
        expected = start.copy()
        mujoco.mju_quatIntegrate(
            expected, np.array(hand.turn) * np.sin(2 * np.pi * np.array(hand.turn_frequency) * t), 1
        )
        np.testing.assert_allclose(end, expected, rtol=0, atol=1e-14)


def test_a_hand_wanders_along_the_worlds_axes_about_its_lift():
    position, quaternion = held()
    hand = Hand()
    moved, _ = hand.poses(TIME, position, quaternion)
    shift = moved - position - hand.lift
    assert (abs(shift) <= np.array(hand.shift) + 1e-14).all()
    assert (abs(shift).max(axis=0) > 0.9 * np.array(hand.shift)).all()


def test_a_hand_that_keeps_still_is_where_the_body_is():
    still = Hand(lift=(0, 0, 0), shift=(0, 0, 0), turn=(0, 0, 0))
    for pose, expected in zip(still.poses(TIME, *held()), held(), strict=True):
        np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-15)
