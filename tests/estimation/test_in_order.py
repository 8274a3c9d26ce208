import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from itertools import count, islice

import pytest

from ident.estimation.pieces import in_order


def test_it_is_map_whoever_finishes_first():
    released = {k: threading.Event() for k in range(8)}
    released[7].set()

    def function(k):
        # Each item waits for the next one.
        assert released[k].wait(timeout=60)
        released.get(k - 1, threading.Event()).set()
        return k**2

    with ThreadPoolExecutor(8) as executor:
        assert list(in_order(executor, function, range(8), ahead=8)) == list(map(lambda k: k**2, range(8)))
        assert list(in_order(executor, function, [])) == []


@pytest.mark.parametrize("ahead", [1, 3, 16])
def test_endless_items_are_drawn_only_so_far_ahead(ahead):
    drawn = count()
    with ThreadPoolExecutor(2) as executor, closing(in_order(executor, str, drawn, ahead=ahead)) as results:
        assert list(islice(results, 10)) == [str(k) for k in range(10)]
    assert next(drawn) == 10 + ahead - 1


def test_an_error_comes_at_its_turn_and_cancels_what_follows():
    done = []

    def function(k):
        done.append(k)
        return 1 / (3 - k)

    with ThreadPoolExecutor(1) as executor:
        results = in_order(executor, function, count(), ahead=2)
        assert list(islice(results, 3)) == [1 / 3, 1 / 2, 1]
        with pytest.raises(ZeroDivisionError):
            next(results)
    assert done in ([0, 1, 2, 3], [0, 1, 2, 3, 4])
    assert list(results) == []
