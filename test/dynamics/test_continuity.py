"""Which blocks a stream consists of: properties over arbitrary mixtures of blocks, losses and other publishers."""

from itertools import pairwise

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from tbm_dynamics.continuity import BELIEVED_S, Continuity, Samples

STEP, COUNT = 1_000_000, 50  # ns; samples of a block of 50 ms
LENGTH = STEP * COUNT
LONGEST = 2 * 10**9
START = 1_700_000_000 * 10**9


def block(stamp):
    return Samples(stamp, np.zeros((COUNT, 6)))


class Stream:
    """Where the admitted blocks end, and what they were."""

    def __init__(self):
        self.continuity, self.end, self.admitted = Continuity(STEP, LONGEST), None, []

    def send(self, stamp):
        for taken in self.continuity.take(block(stamp), self.end):
            self.admitted.append(taken.stamp_ns)
            self.end = taken.stamp_ns + LENGTH


def own(count, first=0):
    return [START + k * LENGTH for k in range(first, first + count)]


far = st.integers(-START, 10**18)
near = st.integers(-3 * LONGEST, 3 * LONGEST)


@given(st.lists(st.tuples(st.booleans(), st.one_of(far, near)), min_size=1, max_size=40))
def test_what_comes_between_the_blocks_of_a_stream_changes_nothing(others):
    stream, strays = Stream(), 0
    for stamp, (stray, offset) in zip(own(len(others)), others, strict=True):
        stream.send(stamp)
        # What continues the stream bit for bit in time is the stream, whoever sends it.
        if stray and 2 * abs(offset - LENGTH) >= STEP:
            stream.send(stamp + offset)
            strays += 1
    stream.send(START + len(others) * LENGTH)
    assert stream.admitted == own(len(others) + 1)
    assert stream.continuity.dropped == strays


@given(st.lists(st.booleans(), max_size=60))
def test_nothing_that_came_of_a_stream_with_losses_is_left_out(lost):
    stream = Stream()
    came = [stamp for stamp, gone in zip(own(len(lost), 3), lost, strict=True) if not gone]
    came = [*own(3), *came, *own(3, first=len(lost) + 3 + 39)]
    for stamp in came:
        stream.send(stamp)
    gaps = [after - before > LENGTH + LONGEST for before, after in pairwise(came)]
    if not any(gaps):
        assert stream.admitted == came
        assert stream.continuity.dropped == 0


@given(st.one_of(far, near), st.integers(3, 10))
def test_a_stream_that_jumped_is_believed_as_a_whole(jump, count):
    stream = Stream()
    for stamp in own(2):
        stream.send(stamp)
    jumped = [START + jump + k * LENGTH for k in range(count)]
    assume(all(2 * abs(stamp - stream.end) >= STEP for stamp in jumped[:3]))  # else it is the stream after all
    for stamp in jumped:
        stream.send(stamp)
    assert count * LENGTH >= BELIEVED_S * 1e9
    assert stream.admitted == own(2) + jumped


def test_what_does_not_belong_together_is_not_believed():
    stream = Stream()
    for stamp in (START, START + 10**12, START - 10**12, START + 2 * 10**12, START):
        stream.send(stamp)
    assert stream.admitted == [START]
    assert stream.continuity.dropped == 3
