"""Native thread pools are at one thread where that is asked for, and no longer."""

from __future__ import annotations

import sys
from threading import Barrier, Event, Thread, current_thread, main_thread

import pytest
import threadpoolctl
from threadpoolctl import threadpool_info, threadpool_limits

from skmotionseg._core.graph.lazy import lazy
from skmotionseg._parallel import threads
from skmotionseg._parallel.threads import single_threaded


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


def run_in_thread(function, *args):
    thread = Thread(target=function, args=args)
    thread.start()
    thread.join()


@pytest.fixture
def two_blas_threads():
    """Pools of two, set by no thread that is still there."""
    limits = []
    run_in_thread(lambda: limits.append(threadpool_limits(2, user_api="blas")))
    yield
    run_in_thread(limits[0].restore_original_limits)


def blas_sizes():
    return [p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"]


@pytest.mark.usefixtures("two_blas_threads")
def test_the_limit_holds_until_the_last_thread_has_left():
    second_came, first_left = Event(), Event()
    seen = []

    @single_threaded
    def first(thread):
        thread.start()
        second_came.wait()

    @single_threaded
    def second():
        second_came.set()
        first_left.wait()
        seen.extend(blas_sizes())

    before = blas_sizes()
    thread = Thread(target=second)
    first(thread)
    first_left.set()
    thread.join()
    assert set(seen) == {1}
    assert blas_sizes() == before
    with threadpool_limits(1):  # no thread keeps others from setting them
        assert set(blas_sizes()) == {1}
    assert blas_sizes() == before


@pytest.mark.usefixtures("two_blas_threads")
def test_another_thread_may_lift_the_limit_at_any_time(monkeypatch):
    """Also while the thread that set it is about to leave, as after Ctrl-C."""
    second_came, second_left = Event(), Event()
    leave = threadpoolctl._ThreadpoolLimiter.__exit__

    def leave_late(limiter, *error):
        if current_thread() is main_thread() and second_came.is_set():
            second_left.wait(timeout=30)
        leave(limiter, *error)

    @single_threaded
    def first(thread):
        thread.start()
        second_came.wait()
        first_is_done.set()

    @single_threaded
    def second():
        second_came.set()
        first_is_done.wait()

    def run_second():
        second()
        second_left.set()

    first_is_done = Event()
    before = blas_sizes()
    monkeypatch.setattr(threadpoolctl._ThreadpoolLimiter, "__exit__", leave_late)
    thread = Thread(target=run_second)
    first(thread)
    thread.join()
    assert blas_sizes() == before


def interrupt_at(n_lines):
    """A trace function that raises at a line of the limit, the n-th to be reached.

    Python leaves a `with` on its first line again, where signals are not handled.
    """
    reached = set()

    def trace_line(frame, event, _):
        if event == "line":
            reached.add((frame, frame.f_lineno))
        if event == "line" and len(reached) == n_lines:
            raise KeyboardInterrupt
        return trace_line

    def trace_call(frame, *_):
        return trace_line if frame.f_code.co_filename == threads.__file__ else None

    return trace_call


@pytest.mark.usefixtures("two_blas_threads")
def test_ctrl_c_at_any_line_leaves_no_limit():
    before, tracing = blas_sizes(), sys.gettrace()
    interrupted = 0
    for n_lines in range(1, 100):
        sys.settrace(interrupt_at(n_lines))
        try:
            single_threaded(blas_sizes)()
        except KeyboardInterrupt:
            interrupted += 1
        finally:
            sys.settrace(tracing)
        assert blas_sizes() == before, f"interrupted at line {n_lines}"
        assert threads._one_blas_thread._users == set()
    assert 15 < interrupted < 99
    assert set(single_threaded(blas_sizes)()) == {1}


class Slow:
    """Has a value that takes until it is told to end; counts how often it is asked."""

    def __init__(self, may_end):
        self.may_end, self.n_computed = may_end, 0
        self.begun = Event()

    @lazy
    def value(self):
        """What is slow."""
        self.begun.set()
        self.n_computed += 1
        assert self.may_end.wait(timeout=30)
        return self.n_computed


def test_a_lazy_value_is_computed_once():
    at_once = Event()
    at_once.set()
    slow = Slow(at_once)
    assert (slow.value, slow.value, slow.n_computed) == (1, 1, 1)
    assert Slow.value.__doc__ == "What is slow."


def test_one_lazy_value_does_not_wait_for_that_of_another():
    """A process that is forked in between would wait for ever."""
    ended, at_once = Event(), Event()
    at_once.set()
    first, second = Slow(ended), Slow(at_once)
    thread = Thread(target=lambda: first.value, daemon=True)
    thread.start()
    assert first.begun.wait(timeout=30)
    other = Thread(target=lambda: second.value, daemon=True)
    other.start()
    assert second.begun.wait(timeout=10)
    ended.set()
    thread.join()
    other.join()
    assert first.n_computed == second.n_computed == 1
