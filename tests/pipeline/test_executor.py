import threading
import time

import pytest

from semsfm_colmap.pipeline.executor import LOOK_AHEAD, ThreadExecutor


@pytest.mark.parametrize("num_threads", [1, 2, 7])
def test_results_come_in_the_order_of_the_items(num_threads):
    def slow_first(k):
        time.sleep(0.02 if k == 0 else 0.0)
        return k * k

    found = list(ThreadExecutor(num_threads).map(slow_first, range(20)))
    assert found == [k * k for k in range(20)]


def test_no_items_give_no_results():
    assert list(ThreadExecutor(2).map(str, [])) == []


def test_only_so_many_items_are_begun_before_their_turn():
    begun = []
    results = ThreadExecutor(2).map(lambda k: begun.append(k) or k, iter(range(100)))
    assert next(results) == 0
    time.sleep(0.05)
    assert len(begun) <= LOOK_AHEAD * 2 + 2


def test_an_error_reaches_the_caller_and_what_was_not_begun_never_is():
    begun = []

    def fail(k):
        begun.append(k)
        if k == 3:
            raise ValueError("three")
        return k

    with pytest.raises(ValueError, match="three"):
        list(ThreadExecutor(1).map(fail, range(100)))
    assert len(begun) < 10


def test_several_threads_take_part():
    barrier = threading.Barrier(2, timeout=5.0)
    assert list(ThreadExecutor(2).map(lambda k: barrier.wait() >= 0, range(2))) == [True, True]


def test_minus_one_is_a_thread_a_core():
    assert ThreadExecutor(-1).num_workers >= 1
    assert ThreadExecutor(3).num_workers == 3
