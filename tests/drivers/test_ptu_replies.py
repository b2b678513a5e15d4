from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from drivers.stages.ptu_replies import Replies, answers

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


ALL = [
    ("done", ""),
    *[("event", letter) for letter in "TTPP"],
    ("done", ""),
    ("done", "185.142800"),
    ("refused", "Illegal command"),
    ("event", "D"),
    ("done", "-907"),
]


@given(st.lists(st.integers(0, len(SAID)), max_size=12).map(sorted))
def test_what_is_said_does_not_depend_on_how_bytes_arrive(cuts):
    edges = [0, *cuts, len(SAID)]
    pieces = [SAID[a:b] for a, b in pairwise(edges)]
    assert replies(pieces, query=True) == ALL


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


def test_numbers():
    reader = Replies()
    reader.feed(
        b"EP * Current Pan position is -12.5\r\n* 1\x800\r\n* Pan acceleration is 20 positions/sec^2\r\n"
    )
    wordy, spoilt, squared = (reader.take(query=True) for _ in range(3))
    assert (wordy.number, wordy.before) == (-12.5, b"EP ")
    assert spoilt.number is None
    assert squared.number == 20


SAID_BY_UNITS = {
    "PP": ("Current Pan position is -500", "Current pan position is 0"),
    "TP": ("Current Tilt position is 12",),
    "PN": ("Minimum Pan position is -3090",),
    "TX": ("Maximum Tilt position is 604",),
    "PR": ("185.1428 seconds arc per Pan position", "92.5714 seconds arc per position"),
    "PS": ("Target Pan speed is 1000 positions/sec",),
    "TU": ("Maximum Tilt speed is 2902 positions/sec",),
    "PL": ("Minimum Pan speed is 31 positions/sec",),
    "TA": ("Tilt acceleration is 2000 positions/sec^2",),
    "L": ("Limit bounds are ENABLED (soft limits enabled)",),
    "V": (
        "Pan-Tilt Controller v1.09.0b, (C)1996 Directed Perception, Inc., All Rights Reserved",
        "PTU-D100E v3.10, (C)FLIR Systems",
    ),
}


def test_an_answer_is_that_of_one_query_only():
    for query, texts in SAID_BY_UNITS.items():
        for text in texts:
            assert [other for other in SAID_BY_UNITS if answers(other, text)] == [query], text
