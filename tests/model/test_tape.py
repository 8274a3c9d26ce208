"""The tape of recorded equations, its derivatives, and its steps for compiled code."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ident.model.adjoint import gradient
from ident.model.tape import Program, Tape

OPERATIONS = ("+", "-", "*", "negative", "sin", "cos", "-1", "0", "1", "half")


def grown(values, choices):
    """Expressions built from earlier ones, equal for numbers and for signals."""
    values = list(values)
    numbers = {"-1": -1, "0": 0, "1": 1.0, "half": 0.5}
    for operation, i, j in choices:
        a, b = values[i % len(values)], values[j % len(values)]
        if operation in numbers:
            values += [a * numbers[operation], numbers[operation] - a, a + numbers[operation], a - numbers[operation]]
        elif operation in ("sin", "cos"):
            values.append({"sin": np.sin, "cos": np.cos}[operation](a))
        else:
            values.append(-a if operation == "negative" else {"+": a + b, "-": a - b, "*": a * b}[operation])
    return values


@given(
    st.lists(st.tuples(st.sampled_from(OPERATIONS), st.integers(0, 40), st.integers(0, 40)), max_size=25),
    st.lists(st.integers(0, 80), min_size=1, max_size=8),
)
def test_a_program_computes_what_was_written(choices, wanted):
    inputs = np.random.default_rng(0).uniform(-0.5, 0.5, size=(3, 5))
    tape = Tape(3)
    written, computed = grown(tape.inputs, choices), grown(inputs, choices)
    picks = [k % len(written) for k in wanted]
    program = Program.of(tape, [written[k] for k in picks])
    out = np.zeros((len(picks), 5))
    program.fill(out)
    program.run(inputs, out)
    expected = np.array([np.broadcast_to(np.clip(computed[k], -1e300, 1e300), 5) for k in picks])
    np.testing.assert_allclose(out, expected, rtol=1e-9, atol=1e-9 * abs(expected).max())


def test_zeros_and_ones_cost_nothing():
    tape = Tape(2)
    a, b = tape.inputs
    assert a * 0 == 0 and 0 * a == 0 and a - a == 0
    assert a * 1 is a and a + 0 is a and a - 0 is a and -1 * -a is a
    assert a + b is b + a and a * b is b * a and a + (-b) is a - b and (-a) * b is -(a * b)
    before = len(tape.steps)
    assert (a * b) * 1 + 0 is b * a and len(tape.steps) == before


DIFFERENTIABLE = ("+", "-", "*", "/", "negative", "sin", "cos", "tanh", "half", "from one")
STEP = 1e-5


def grown_program(values, choices):
    """Expressions built from earlier ones, equal for numbers and for signals, that stay small."""
    values = list(values)
    for operation, i, j in choices:
        a, b = values[i % len(values)], values[j % len(values)]
        values.append(
            {
                "+": lambda a, b: a + b,
                "-": lambda a, b: a - b,
                "*": lambda a, b: np.sin(a) * b,
                "/": lambda a, b: a / (np.cos(b) + 2.5),
                "negative": lambda a, b: -a,
                "sin": lambda a, b: np.sin(a),
                "cos": lambda a, b: np.cos(a),
                "tanh": lambda a, b: np.tanh(a),
                "half": lambda a, b: a * 0.5,
                "from one": lambda a, b: 1 / (3 - np.tanh(a)),
            }[operation](a, b)
        )
    return values


@given(
    st.lists(st.tuples(st.sampled_from(DIFFERENTIABLE), st.integers(0, 20), st.integers(0, 20)), max_size=15),
    st.integers(0, 20),
    st.integers(0, 2**32 - 1),
)
def test_gradients_are_the_differences_of_what_was_written(choices, wanted, seed):
    x = np.random.default_rng(seed).uniform(-1, 1, size=(3, 4))
    tape = Tape(3)
    written = grown_program(tape.inputs, choices)
    pick = wanted % len(written)
    program = Program.of(tape, gradient(written[pick], tape.inputs))
    out = np.zeros((3, 4))
    program.fill(out)
    program.run(x, out)
    for k, own in enumerate(out):
        up, down = (np.array(grown_program(x + s * STEP * np.eye(3)[k][:, None], choices)[pick]) for s in (1, -1))
        np.testing.assert_allclose(own, (up - down) / (2 * STEP), rtol=1e-4, atol=1e-6 * max(1, abs(up).max()))
