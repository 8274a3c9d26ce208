"""Compiled code gives the results of numpy."""

import numpy as np
import pytest
from closeness import close
from mechanisms import random_states, random_tree

from ident import BaseMotion, Equations, Mechanism, Motion, Samples
from ident.estimation.accumulator import accumulate
from ident.model import compiled, regressor, tape
from ident.model.compiled import BLOCK, OTHERS
from ident.model.tape import Program, Tape

pytestmark = pytest.mark.skipif(not compiled.available(), reason="built without a compiler, or switched off")


@pytest.fixture(params=compiled.WIDTHS, ids="{} bits".format, autouse=True)
def width(request, monkeypatch):
    """Code for narrower registers than this processor's has to give the same."""
    if request.param > compiled._library().widest():
        pytest.skip(f"This processor has no registers of {request.param} bits.")
    monkeypatch.setattr(compiled, "_width", lambda: request.param)


def both(function):
    with compiled.switched(False):
        plain = function()
    with compiled.switched(True):
        return function(), plain


@pytest.mark.parametrize(("seed", "samples"), [(0, 7), (1, BLOCK), (2, BLOCK + 1)])
def test_regressors_of_random_trees_are_those_of_numpy(seed, samples):
    rng = np.random.default_rng(seed)
    tree, gravity = random_tree(rng, 5), rng.normal(size=3)
    states = random_states(rng, tree, samples)
    moving = BaseMotion.from_free_joint(rng.normal(size=(samples, 7)), *rng.normal(size=(2, samples, 6)))
    for of in (regressor.base_wrench_regressor, regressor.joint_torque_regressor):
        for base in (None, moving):
            close(*both(lambda of=of, base=base: of(tree, *states, gravity=gravity, base=base)), 1e-13)


@pytest.mark.parametrize(
    ("seed", "bodies", "samples", "weighted"), [(0, 2, BLOCK, False), (1, 2, BLOCK + 1, True), (2, 4, 333, True)]
)
def test_gram_matrices_are_those_of_blas(seed, bodies, samples, weighted):
    """Few columns and many, with constant offsets and weights, and overlapping blocks."""
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, bodies)
    equations = Equations.of_wrench(Mechanism(tree, rng.normal(size=3))).with_offsets(range(seed % 3))
    given = Samples(Motion(*random_states(rng, tree, samples)), rng.normal(size=(samples, 6)))
    weights = rng.uniform(0.1, 1, size=(samples, 6)) if weighted else None
    factor = accumulate(equations, given).factor
    fast, plain = both(lambda: accumulate(equations, given, factor=factor, factors=weights))
    close(fast.grams, plain.grams, 1e-13 * len(factor))
    close(fast.factor, plain.factor, 1e-13 * len(factor))


@pytest.mark.parametrize("size", [1e-9, 1.0, 2.0**19 - 1, 1e9])
def test_sines_and_cosines_are_right_to_two_units_in_the_last_place(size):
    """Also near multiples of quarter turns, where the reduced argument needs all digits."""
    quarters = np.arange(-50, 51) * np.pi / 2
    angles = np.concatenate([np.random.default_rng(0).uniform(-size, size, 1000), quarters[abs(quarters) <= size]])
    tape, out = Tape(1), np.zeros((2, len(angles)))
    with compiled.switched(True):
        Program.of(tape, [np.sin(tape.inputs[0]), np.cos(tape.inputs[0])]).run(angles[None], out)
    for computed, function in zip(out, (np.sin, np.cos), strict=True):
        exact = function(angles.astype(np.longdouble))
        assert (abs(computed - exact) <= 2.5 * np.spacing(abs(exact.astype(float)))).all()


def test_every_operation_of_the_tape_is_known():
    known = {np.negative, np.positive, np.add, np.subtract, np.multiply, *OTHERS}
    assert set(tape._DERIVATIVES) | {np.positive} == known


INPUTS, NUMBERS, RESULTS, REGISTERS = 3, (2.0, -0.5), 3, 4
FIRST = INPUTS + len(NUMBERS) + RESULTS
SIMPLE = (np.negative, np.positive, np.add, np.subtract, np.multiply)


def random_program(rng, length):
    """A program mainly of sums, products and negatives, which reuses few registers, as real programs do."""
    readable, code = list(range(INPUTS + len(NUMBERS))), []
    for _ in range(length):
        operation = tuple(OTHERS)[rng.integers(4)] if rng.random() < 0.1 else SIMPLE[rng.integers(5)]
        x, y = (int(readable[k]) for k in rng.integers(len(readable), size=2))
        target = int(rng.integers(FIRST - RESULTS if rng.random() < 0.2 else FIRST, FIRST + REGISTERS))
        # Quotients have large divisors, so that rounding errors stay small.
        y = INPUTS if operation is np.divide else y
        code.append((operation, x, y if operation.nin == 2 else None, target))
        readable += [target] * (target not in readable)
    code += [(np.positive, readable[-1 - k % 4], None, FIRST - RESULTS + k) for k in range(RESULTS)]
    return Program(INPUTS, NUMBERS, RESULTS, REGISTERS, (), tuple(code))


def test_random_programs_that_combine_operations_give_what_numpy_gives():
    rng = np.random.default_rng(0)
    for length in range(1, 20):
        program, x = random_program(rng, length), rng.normal(size=(INPUTS, BLOCK))

        def ran(program=program, x=x):
            out = np.zeros((RESULTS, BLOCK))
            with np.errstate(over="ignore", invalid="ignore"):
                program.run(x, out)
            return out

        fast, plain = both(ran)
        np.testing.assert_allclose(fast, plain, rtol=1e-9, atol=1e-9 * np.max(abs(plain), initial=1))
