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
