# SPDX-License-Identifier: GPL-3.0-or-later
"""Work that is done ahead: its order, its bound, its errors and its end."""

import threading

import pytest

from noisy_world.core.machine import done_ahead


def test_order_and_bound():
    begun, release = [], threading.Event()

    def work(item):
        begun.append(item)
        if item == 0:
            release.wait(300)  # the others overtake the first
        return -item

    done = done_ahead(work, iter(range(100)), threads=3, ahead=5, name="test")
    threading.Timer(0.1, release.set).start()
    assert next(done) == (0, 0)
    assert max(begun) <= 5
    assert list(done) == [(item, -item) for item in range(1, 100)]


def test_an_error_comes_in_its_place():
    done = done_ahead(lambda item: 1 // item, [2, 1, 0, 1], threads=2, ahead=4, name="test")
    assert [next(done), next(done)] == [(2, 0), (1, 1)]
    with pytest.raises(ZeroDivisionError):
        next(done)


def test_who_asks_no_more_waits_for_what_is_begun_and_for_nothing_else():
    begun = []
    done = done_ahead(begun.append, iter(range(1000)), threads=1, ahead=3, name="test")
    next(done)
    done.close()
    assert len(begun) <= 4
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("test_")]


def test_nothing():
    assert list(done_ahead(str, [], threads=2, ahead=1, name="test")) == []
