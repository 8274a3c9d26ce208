"""Steps of a program for `blocks.c`, with products and negatives fused into the sums that use them.

Sums, differences, negatives and products are all `± a b ± c`, with ones and zeros for missing operands.
"""

from collections.abc import Sequence
from itertools import chain

import numpy as np

Instruction = tuple[np.ufunc, int, int | None, int]
"""Operation, places of its one or two operands, and place of its result."""

LINEAR = 0
"""Code of `± a b ± c` in `blocks.c`."""

OTHERS = {np.sin: 1, np.cos: 2, np.tanh: 3, np.divide: 4}
"""Codes of the other operations there."""

SUMS = np.add, np.subtract
"""Operations into which a product may be fused."""


def steps(code: Sequence[Instruction], registers: int, zero: int, one: int) -> np.ndarray:
    """Steps as rows: operation, places of a, b, c and of the result, 1 if `a b` is subtracted, 1 if c is.

    Args:
        code: Instructions of the program.
        registers: The first place of intermediate results.
        zero: Place of zeros.
        one: Place of ones.
    """
    taken_up, rows = _taken_up(code, registers), []
    # Signed products that are fused instead of computed, by the places of their results.
    products = dict[int, tuple[int, int, bool]]()
    for k, (operation, x, y, target) in enumerate(code):
        if operation in OTHERS:
            rows.append((OTHERS[operation], x, x if y is None else y, zero, target, False, False))
            products.pop(target, None)
            continue
        term, c, minus = products.get(x, (x, one, False)), zero, False
        if operation is np.negative:
            term = *term[:2], not term[2]
        elif y is not None:
            factor, b, sign = products.get(y, (y, one, False))
            if operation is np.multiply:
                term = term[0], factor, term[2] != sign
            else:
                other = factor, b, sign != (operation is np.subtract)
                term, (c, _, minus) = (term, other) if b == one else (other, term)
        if k in taken_up:
            products[target] = term
        else:
            products.pop(target, None)
            rows.append((LINEAR, *term[:2], c, target, term[2], minus))
    return np.fromiter(chain.from_iterable(rows), np.int32).reshape(-1, 7)


def _taken_up(code: Sequence[Instruction], registers: int) -> set[int]:
    """Indices of negatives and products that are fused into the steps that use them.

    A negative is fused into all its users, a product into a sum that is its only user, one for each sum. Their operands
    must not be overwritten before.
    """
    taken, with_product = set[int](), set[int]()
    places = 1 + max((max(x, x if y is None else y, target) for _, x, y, target in code), default=0)
    readers, overwritten = [list[int]() for _ in range(places)], [len(code)] * places
    for k in reversed(range(len(code))):
        operation, x, y, target = code[k]
        own, readers[target], suits = readers[target], [], False
        if own and target >= registers and (operation is np.multiply or operation is np.negative):
            last = max(own)
            if operation is np.negative:
                suits = not any(code[reader][0] in OTHERS for reader in own)
            else:
                suits = len(own) == 1 and code[last][0] in SUMS and last not in with_product
            suits = suits and overwritten[x] >= last and (y is None or overwritten[y] >= last)
        if suits:
            taken.add(k)
            if operation is np.multiply:
                with_product.add(last)
        overwritten[target] = k
        own = own if suits else [k]
        readers[x] += own
        if y is not None:
            readers[y] += own
    return taken
