import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ident.model.adjoint import gradient
from ident.model.tape import Program, Tape

OPERATIONS = ("+", "-", "*", "/", "negative", "sin", "cos", "tanh", "half", "from one")
STEP = 1e-5


def grown(values, choices):
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
    st.lists(st.tuples(st.sampled_from(OPERATIONS), st.integers(0, 20), st.integers(0, 20)), max_size=15),
    st.integers(0, 20),
    st.integers(0, 2**32 - 1),
)
def test_gradients_are_the_differences_of_what_was_written(choices, wanted, seed):
    x = np.random.default_rng(seed).uniform(-1, 1, size=(3, 4))
    tape = Tape(3)
    written = grown(tape.inputs, choices)
    pick = wanted % len(written)
    program = Program.of(tape, gradient(written[pick], tape.inputs))
    out = np.zeros((3, 4))
    program.fill(out)
    program.run(x, out)
    for k, own in enumerate(out):
        up, down = (np.array(grown(x + s * STEP * np.eye(3)[k][:, None], choices)[pick]) for s in (1, -1))
        np.testing.assert_allclose(own, (up - down) / (2 * STEP), rtol=1e-4, atol=1e-6 * max(1, abs(up).max()))
