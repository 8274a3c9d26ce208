"""The tape of recorded equations, and its derivatives."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ident.model.tape import Program, Tape, gradient

EXACT = {
    "+": lambda a, b: [a + b],
    "-": lambda a, b: [a - b],
    "*": lambda a, b: [a * b],
    "negative": lambda a, _: [-a],
    "sin": lambda a, _: [np.sin(a)],
    "cos": lambda a, _: [np.cos(a)],
} | {f"with {x}": lambda a, _, x=x: [a * x, x - a, a + x, a - x] for x in (-1, 0, 1.0, 0.5)}
SMOOTH = {name: EXACT[name] for name in ("+", "-", "negative", "sin", "cos")} | {
    "*": lambda a, b: [np.sin(a) * b],
    "/": lambda a, b: [a / (np.cos(b) + 2.5)],
    "tanh": lambda a, _: [np.tanh(a)],
    "half": lambda a, _: [a * 0.5],
    "from one": lambda a, _: [1 / (3 - np.tanh(a))],
}
"""Operations whose results and derivatives stay small."""


def grown(values, choices, operations):
    """Expressions built from earlier ones, equal for numbers and for signals."""
    values = list(values)
    for name, i, j in choices:
        values += operations[name](values[i % len(values)], values[j % len(values)])
    return values


def run(tape, results, inputs):
    program, out = Program.of(tape, results), np.zeros((len(results), inputs.shape[1]))
    program.fill(out)
    program.run(inputs, out)
    return out


def choices_of(operations, most, size):
    return st.lists(
        st.tuples(st.sampled_from([*operations]), st.integers(0, most), st.integers(0, most)), max_size=size
    )


@given(choices_of(EXACT, 40, 25), st.lists(st.integers(0, 80), min_size=1, max_size=8))
def test_a_program_computes_what_was_written(choices, wanted):
    inputs, tape = np.random.default_rng(0).uniform(-0.5, 0.5, size=(3, 5)), Tape(3)
    written, computed = grown(tape.inputs, choices, EXACT), grown(inputs, choices, EXACT)
    picks = [k % len(written) for k in wanted]
    out = run(tape, [written[k] for k in picks], inputs)
    expected = np.array([np.broadcast_to(np.clip(computed[k], -1e300, 1e300), 5) for k in picks])
    np.testing.assert_allclose(out, expected, rtol=1e-9, atol=1e-9 * abs(expected).max())


def test_zeros_and_ones_cost_nothing():
    tape = Tape(2)
    a, b = tape.inputs
    assert a * 0 == 0 and 0 * a == 0 and a - a == 0
    assert a * 1 is a and a + 0 is a and a - 0 is a and -1 * -a is a
    assert a + b is b + a and a * b is b * a and a + (-b) is a - b and (-a) * b is -(a * b)
    before = len(tape.signals)
    assert (a * b) * 1 + 0 is b * a and len(tape.signals) == before
    assert gradient(1.0, tape.inputs) == [0.0, 0.0]


@given(choices_of(SMOOTH, 20, 15), st.integers(0, 20), st.integers(0, 2**32 - 1))
def test_gradients_are_the_differences_of_what_was_written(choices, wanted, seed):
    x, tape, step = np.random.default_rng(seed).uniform(-1, 1, size=(3, 4)), Tape(3), 1e-5
    written = grown(tape.inputs, choices, SMOOTH)
    pick = wanted % len(written)
    out = run(tape, gradient(written[pick], tape.inputs), x)
    for own, e in zip(out, step * np.eye(3)[..., None], strict=True):
        up, down = (np.array(grown(x + s * e, choices, SMOOTH)[pick]) for s in (1, -1))
        np.testing.assert_allclose(own, (up - down) / (2 * step), rtol=1e-4, atol=1e-6 * max(1, abs(up).max()))
