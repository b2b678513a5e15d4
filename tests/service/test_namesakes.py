"""Two rigs with one name: each says so, while it lasts."""

import time
from collections.abc import Callable
from contextlib import ExitStack

from service.daemon.namesakes import Namesakes
from service.daemon.states import States
from service.messages.encoding import event_messages
from service.messages.events import StatusTold
from service.messages.status import Status
from service.sinks.publisher import Publisher
from service.wire.session import open_session


def told(namesakes: Namesakes, states: States, *, degraded: bool, seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while bool(states.degraded) is not degraded:
        assert time.monotonic() < deadline, states.degraded
        namesakes.look()
        time.sleep(0.05)


def serve(stack: ExitStack, endpoint: str, prefix: str, connect: tuple[str, ...] = ()) -> Namesakes:
    """What answers as a service of a name does; its clock runs ten times as fast."""
    session = stack.enter_context(open_session(listen=(endpoint,), connect=connect))
    publisher = Publisher(session, prefix)
    publisher.open()
    stack.callback(publisher.close)
    publisher.publish(event_messages(StatusTold(Status(state="idle"))))
    return Namesakes(session, prefix, States(), lambda: 10 * time.monotonic())


def test_two_of_one_name_are_told_until_one_is_gone(free_endpoint: Callable[[], str]) -> None:
    here, there = free_endpoint(), free_endpoint()
    with ExitStack() as stack:
        one = serve(stack, here, "hall/rig")
        with ExitStack() as other:
            serve(other, there, "hall/rig", (here,))
            told(one, one._states, degraded=True)
            (fault,) = one._states.degraded
            assert fault.what == "1 more on this network called hall/rig: they are mixed up at who listens"
            assert "another zenoh.prefix" in fault.remedy
        told(one, one._states, degraded=False)


def test_rigs_of_different_names_do_not_disturb_each_other(free_endpoint: Callable[[], str]) -> None:
    here, there = free_endpoint(), free_endpoint()
    with ExitStack() as stack:
        one = serve(stack, here, "hall/left")
        other = serve(stack, there, "hall/right", (here,))
        until = time.monotonic() + 3.0  # six questions
        while time.monotonic() < until:
            one.look()
            other.look()
            time.sleep(0.05)
        assert one._answered | {one._own} == {one._own}
        assert (one._states.degraded, other._states.degraded) == ((), ())
