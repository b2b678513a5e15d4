"""Items made ahead in a thread."""

import threading

import pytest

from service.jobs.prefetch import prefetched


def test_items_come_in_order_and_the_thread_ends():
    assert list(prefetched(iter(range(100)), 3)) == list(range(100))
    assert list(prefetched(iter([]), 3)) == []
    assert not [thread for thread in threading.enumerate() if thread.name == "prefetch"]


def test_what_making_raises_comes_in_its_place():
    def made():
        yield 1
        yield 2
        raise ZeroDivisionError

    items = prefetched(made(), 8)
    assert [next(items), next(items)] == [1, 2]
    with pytest.raises(ZeroDivisionError):
        next(items)


def test_who_wants_no_more_ends_it():
    endless = prefetched(iter(lambda: 0, 1), 2)
    assert next(endless) == 0
    endless.close()
    assert not [thread for thread in threading.enumerate() if thread.name == "prefetch"]
