"""The queue before a sink."""

import threading

from service.sinks.queue import BoundedQueue


def test_a_full_queue_loses_the_oldest_and_counts_it() -> None:
    lost: list[str] = []
    queue: BoundedQueue[str] = BoundedQueue(
        3, 100, dropped=lost.append, droppable=lambda item: item != "report"
    )
    for item in ("report", "a", "b", "c", "d"):
        queue.put(item, 10)
    assert lost == ["a", "b"]
    queue.put("large", 95)
    assert lost == ["a", "b", "c", "d", "report"]
    queue.put("larger than all", 1000)
    assert queue.get() == "larger than all"
    queue.close()
    queue.put("late", 1)
    assert queue.get() is None
    assert lost == ["a", "b", "c", "d", "report", "large", "late"]


def test_a_patient_producer_waits_for_room() -> None:
    lost: list[int] = []
    queue: BoundedQueue[int] = BoundedQueue(2, 1000, dropped=lost.append)
    put: list[bool] = []
    producer = threading.Thread(
        target=lambda: put.extend(queue.put_patiently(number, 1, 30.0) for number in range(50))
    )
    producer.start()
    taken = [queue.get() for _ in range(50)]
    producer.join()
    assert taken == list(range(50))
    assert put == [True] * 50
    assert lost == []
    queue.close()
    assert queue.get() is None


def test_a_producer_does_not_wait_for_ever() -> None:
    queue: BoundedQueue[int] = BoundedQueue(1, 1000)
    assert queue.put_patiently(1, 1, 0.1)
    assert not queue.put_patiently(2, 1, 0.1)
    assert queue.get() == 1
