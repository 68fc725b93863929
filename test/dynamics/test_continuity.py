"""Which blocks a stream consists of: properties over arbitrary mixtures of blocks, losses and other publishers."""

from itertools import pairwise

from hypothesis import assume, given
from hypothesis import strategies as st

from tbm_dynamics.streaming.continuity import CONFIRMED_NS, MOST_SEQUENCES, Continuity, StreamBlock

STEP, COUNT = 1_000_000, 50  # ns; samples of a block of 50 ms
LENGTH = STEP * COUNT
LONGEST, JUMP = 2 * 10**9, 5 * 10**8
START = 1_700_000_000 * 10**9


def block(stamp):
    return StreamBlock(stamp, stamp + LENGTH, STEP / 2, COUNT, None)


class Stream:
    """Where the admitted blocks end, and what they were."""

    def __init__(self, **options):
        self.continuity, self.end, self.admitted = Continuity(LONGEST, **options), None, []

    def send(self, stamp):
        for admitted in self.continuity.add(block(stamp), self.end):
            self.admitted.append(admitted.begin_ns)
            self.end = admitted.end_ns


def own(count, first=0):
    return [START + k * LENGTH for k in range(first, first + count)]


far = st.integers(-START, 10**18)
near = st.integers(-3 * LONGEST, 3 * LONGEST)


@given(st.lists(st.tuples(st.booleans(), st.one_of(far, near)), min_size=1, max_size=40))
def test_blocks_between_those_of_a_stream_change_nothing(others):
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
def test_no_block_of_a_stream_with_losses_is_left_out(lost):
    stream = Stream()
    received = [stamp for stamp, gone in zip(own(len(lost), 3), lost, strict=True) if not gone]
    received = [*own(3), *received, *own(3, first=len(lost) + 3 + 39)]
    for stamp in received:
        stream.send(stamp)
    gaps = [after - before > LENGTH + LONGEST for before, after in pairwise(received)]
    if not any(gaps):
        assert stream.admitted == received
        assert stream.continuity.dropped == 0


@given(st.one_of(far, near), st.integers(10, 15))
def test_a_stream_that_jumped_is_admitted_as_a_whole(jump, count):
    stream = Stream()
    for stamp in own(2):
        stream.send(stamp)
    jumped = [START + jump + k * LENGTH for k in range(count)]
    assume(all(2 * abs(stamp - stream.end) >= STEP for stamp in jumped))  # else it is the stream after all
    for stamp in jumped:
        stream.send(stamp)
    assert count * LENGTH >= CONFIRMED_NS
    assert stream.admitted == own(2) + jumped


def test_blocks_that_follow_no_other_are_not_admitted():
    stream = Stream()
    others = [START + (-1) ** k * (k + 1) * 10**12 for k in range(2 * MOST_SEQUENCES)]
    for stamp in (START, *others):
        stream.send(stamp)
    assert stream.admitted == [START]
    assert stream.continuity.dropped == MOST_SEQUENCES  # no more than so many wait
    stream.send(START + LENGTH)
    assert stream.admitted == own(2)
    assert (stream.continuity.dropped, stream.continuity.dropped_samples) == (
        2 * MOST_SEQUENCES,
        2 * MOST_SEQUENCES * COUNT,
    )


away = st.one_of(st.integers(11 * LENGTH, 10**18), st.integers(11 * LENGTH, 3 * LONGEST))


@given(st.integers(1, 7), st.integers(0, 20), away, st.sampled_from([-1, 1]), st.integers(1, 3))
def test_a_loss_beside_other_publishers_is_got_over(lost, at, distance, side, others):
    """The stream neither stands still nor goes on with another, however their blocks alternate."""
    offset = side * distance
    if abs(offset) <= LONGEST + 20 * LENGTH:
        lost = 1  # what is as near as the stream after a loss is admitted as soon
    stream, gone = Stream(jump_ns=JUMP), range(at + 3, at + 3 + lost)
    for k in range(40):
        if k not in gone:
            stream.send(START + k * LENGTH)
        for other in range(others):
            stream.send(START + k * LENGTH + offset + other * 10 * LONGEST)
    assert stream.admitted == [START + k * LENGTH for k in range(40) if k not in gone]
