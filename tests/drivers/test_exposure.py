"""When a frame was exposed: the interval always holds the truth, whatever the camera does."""

from hypothesis import given
from hypothesis import strategies as st

from drivers.exposure import BULK_RATE, mid_exposure

MS = 1_000_000


@given(
    waits=st.booleans(),
    exposure=st.integers(0, 200 * MS),
    delay=st.integers(0, 50 * MS),
    extra=st.integers(0, 50 * MS),
    frame_bytes=st.integers(0, 200_000),
    slack=st.floats(0, 1),
)
def test_the_middle_is_in_the_interval(waits, exposure, delay, extra, frame_bytes, slack):
    requested = 10**12
    began = requested + delay if waits else requested + delay - exposure
    ended = began + exposure
    transfer = round(frame_bytes / BULK_RATE * 1e9)
    finished = max(ended, requested) + transfer + extra
    known = exposure / 1e9
    middle, uncertainty = mid_exposure(
        requested, finished, known * (1 - slack), known * (1 + slack), frame_bytes, waits
    )
    assert abs((began + ended) // 2 - middle) <= uncertainty + 2  # rounding to ns
