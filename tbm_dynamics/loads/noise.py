"""Random numbers that are a pure function of (seed, stream name, absolute block index)."""

from hashlib import blake2b

import numpy as np

WORD = 2**64


def hashed_generator(seed: int, stream: str, block: int = 0) -> np.random.Generator:
    """Return the random numbers of one block of one stream.

    Philox is counter based: the seed and the hashed name are its key and the block index is a word of its counter,
    so every block can be reached directly and no two blocks share numbers.

    Parameters
    ----------
    seed : int
        Seed of the run.
    stream : str
        Name of the quantity the numbers are for, e.g. ``"loads/fx"``.
    block : int
        Absolute block index; negative ones are allowed.

    Returns
    -------
    numpy.random.Generator
        Positioned at the beginning of the block.
    """
    name = int.from_bytes(blake2b(stream.encode(), digest_size=8).digest(), "little")
    key = np.array([seed % WORD, name], dtype=np.uint64)
    counter = np.array([0, block % WORD, 0, 0], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=counter))
