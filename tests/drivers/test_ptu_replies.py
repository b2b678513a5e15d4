from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from drivers.stages.ptu_replies import Replies

SAID = b"PP *\r\n!T!T!P!P*\r\n\xff~* 185.142800\r\n! Illegal command\r\n!D\r* -907\r"


def replies(pieces, query):
    reader, found = Replies(), []
    for piece in pieces:
        reader.feed(piece)
        while (reply := reader.take(query)) is not None:
            found.append((reply.kind, reply.text))
    while (reply := reader.take(query, final=True)) is not None:
        found.append((reply.kind, reply.text))
    return found


WITH_NUMBERS = [
    *[("event", letter) for letter in "TTPP"],
    ("done", "185.142800"),
    ("refused", "Illegal command"),
    ("event", "D"),
    ("done", "-907"),
]


@given(st.lists(st.integers(0, len(SAID)), max_size=12).map(sorted))
def test_answers_to_queries_do_not_depend_on_how_bytes_arrive(cuts):
    edges = [0, *cuts, len(SAID)]
    pieces = [SAID[a:b] for a, b in pairwise(edges)]
    assert replies(pieces, query=True) == WITH_NUMBERS


def test_answers_to_commands_need_no_end_of_line():
    assert replies([b"!T!T!P!P*"], query=False) == [*[("event", letter) for letter in "TTPP"], ("done", "")]


def test_event_and_refusal_are_told_apart():
    reader = Replies()
    reader.feed(b"!P")
    assert reader.take(query=False) is None, "a word may follow"
    reader.feed(b"osition out of range\r\n")
    refusal = reader.take(query=False)
    assert (refusal.kind, refusal.text) == ("refused", "Position out of range")
    reader.feed(b"!P")
    assert reader.take(query=False, final=True).kind == "event"


def test_numbers_and_manner():
    reader = Replies()
    reader.feed(b"EP * Current Pan position is -12.5\r\n* 1\x800\r\n")
    wordy, spoilt = reader.take(query=True), reader.take(query=True)
    assert (wordy.number, wordy.verbose, wordy.before) == (-12.5, True, b"EP ")
    assert spoilt.number is None
