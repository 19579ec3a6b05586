"""RF has the same bits, whoever computes it."""

import hashlib
import multiprocessing
import threading

import numpy as np
import pytest
from echoes import CLOUD, SMALL, WEIGHTS

from usbench.envs import threads
from usbench.envs.field import elevation, response_table
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq


def _digest():
    response_table.forget_tables()
    elevation.elevation_taps.cache_clear()
    array = LinearArray(**SMALL)
    iq, _ = simulate_iq(CLOUD, WEIGHTS, array, 35e-3, np.arange(-7, 8) * 1.3e-3)
    return hashlib.sha256(iq.tobytes()).hexdigest()


def test_same_bits_for_any_number_of_threads(monkeypatch, with_table):
    digests = set()
    for n in ("1", "2", "3"):
        monkeypatch.setenv("USBENCH_THREADS", n)
        digests.add(_digest())
    assert len(digests) == 1


@pytest.mark.parametrize("n_items", [1, 2, 3, 64])
def test_items_are_divided_once_and_in_order(monkeypatch, n_items):
    monkeypatch.setenv("USBENCH_THREADS", "3")
    slices = threads.divided(n_items)
    assert [k for part in slices for k in range(n_items)[part]] == list(range(n_items))
    sizes = [part.stop - part.start for part in slices]
    assert len(slices) == min(3, n_items) and max(sizes) - min(sizes) <= 1


@pytest.mark.parametrize("text", ["0", "-1", "two", "1.5"])
def test_refuses_a_number_of_threads(monkeypatch, text):
    monkeypatch.setenv("USBENCH_THREADS", text)
    with pytest.raises(ValueError, match=f"USBENCH_THREADS must be a whole number from 1, not '{text}'"):
        _digest()


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork on this platform")
def test_a_forked_child_computes_the_same(with_table):
    here = _digest()
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(_digest).get(timeout=600) == here


def test_threads_stay_and_what_they_call_uses_one(monkeypatch):
    monkeypatch.setenv("USBENCH_THREADS", "3")
    all_busy = threading.Barrier(3)

    def work(_):
        all_busy.wait(timeout=600)  # or one thread may do the work of all
        return threading.current_thread(), threads.n_threads()

    first, second = ([*zip(*threads.in_parallel(work, range(3)), strict=True)] for _ in range(2))
    assert len(set(first[0])) == 3 and set(first[0]) == set(second[0])
    assert threading.current_thread() not in first[0]
    assert first[1] == second[1] == (1, 1, 1) and threads.n_threads() == 3


def test_error_in_a_thread_is_raised_where_the_work_was_asked_for(monkeypatch):
    monkeypatch.setenv("USBENCH_THREADS", "2")
    with pytest.raises(ZeroDivisionError):
        threads.in_parallel(lambda n: 1 / n, [1, 0])
    assert threads.in_parallel(lambda n: 1 / n, [1, 2]) == [1.0, 0.5]
