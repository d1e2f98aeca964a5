"""Native thread pools are at one thread where that is asked for, and no longer."""

from __future__ import annotations

from threading import Barrier, Thread

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from skmotionseg._threads import single_threaded


def pool_sizes():
    return {pool["filepath"]: pool["num_threads"] for pool in threadpool_info()}


def test_pools_are_limited_and_restored():
    with threadpool_limits(2):
        before = pool_sizes()
        assert set(single_threaded(pool_sizes)().values()) == {1}
        assert pool_sizes() == before


def test_an_error_inside_restores_the_pools():
    @single_threaded
    def fail():
        raise KeyError

    with threadpool_limits(2):
        before = pool_sizes()
        with pytest.raises(KeyError):
            fail()
        assert pool_sizes() == before


def test_overlapping_threads_leave_the_pools_as_they_were():
    both = Barrier(2)

    @single_threaded
    def meet():
        both.wait()

    with threadpool_limits(2):
        before = pool_sizes()
        threads = [Thread(target=meet) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert pool_sizes() == before
