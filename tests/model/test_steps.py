"""Steps for compiled code do what the code says, also when they combine operations."""

import numpy as np
import pytest

from ident.model import compiled
from ident.model.tape import Program

INPUTS, NUMBERS, RESULTS, REGISTERS = 3, (2.0, -0.5), 3, 4
FIRST = INPUTS + len(NUMBERS) + RESULTS
SIMPLE = (np.negative, np.positive, np.add, np.subtract, np.multiply)
OTHERS = (np.sin, np.cos, np.tanh, np.divide)


def random_program(rng, length):
    """A program mainly of sums, products and negatives, which reuses few registers, as real programs do."""
    readable = list(range(INPUTS + len(NUMBERS)))
    code = []
    for _ in range(length):
        operation = OTHERS[rng.integers(4)] if rng.random() < 0.1 else SIMPLE[rng.integers(5)]
        x, y = (int(readable[k]) for k in rng.integers(len(readable), size=2))
        target = int(rng.integers(FIRST - RESULTS if rng.random() < 0.2 else FIRST, FIRST + REGISTERS))
        # Quotients have large divisors, so that rounding errors stay small.
        y = INPUTS if operation is np.divide else y
        code.append((operation, x, y if operation.nin == 2 else None, target))
        readable += [target] * (target not in readable)
    code += [(np.positive, readable[-1 - k % 4], None, FIRST - RESULTS + k) for k in range(RESULTS)]
    return Program(INPUTS, NUMBERS, RESULTS, REGISTERS, (), tuple(code))


@pytest.mark.skipif(not compiled.available(), reason="built without a compiler, or switched off")
@pytest.mark.parametrize("seed", range(10))
def test_random_programs_give_what_numpy_gives(seed):
    rng = np.random.default_rng(seed)
    for length in range(1, 20):
        program, x = random_program(rng, length), rng.normal(size=(INPUTS, compiled.BLOCK))
        computed = []
        for on in (False, True):
            out = np.zeros((RESULTS, compiled.BLOCK))
            with compiled.switched(on), np.errstate(over="ignore", invalid="ignore"):
                program.run(x, out)
            computed.append(out)
        np.testing.assert_allclose(*computed, rtol=1e-9, atol=1e-9 * np.max(abs(computed[0]), initial=1))
