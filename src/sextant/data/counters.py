r"""Counter-based random numbers: the i-th number is a function of (seed, i), available without the numbers before it.

Philox 4x32-10: ten rounds of multiplication, exchange and key, on four words of 32 bits.

Source: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
"""

import numpy as np
from jaxtyping import Float64, Int64, UInt64
from numpy import ndarray

WORD = np.uint64(0xFFFFFFFF)
MULTIPLIERS = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
KEY_STEPS = 0x9E3779B9, 0xBB67AE85
ROUNDS = 10


def philox(counters: UInt64[ndarray, "n 4"], seed: int) -> UInt64[ndarray, "n 4"]:
    """Four random words of 32 bits for each counter of four such words; ``seed`` is the key of 64 bits."""
    a, b, c, d = (np.ascontiguousarray(word) & WORD for word in counters.T)
    keys = [seed & 0xFFFFFFFF, (seed >> 32) & 0xFFFFFFFF]
    high = np.uint64(32)
    for _ in range(ROUNDS):
        first, second = MULTIPLIERS[0] * a, MULTIPLIERS[1] * c
        a, c = (second >> high) ^ b ^ np.uint64(keys[0]), (first >> high) ^ d ^ np.uint64(keys[1])
        b, d = second & WORD, first & WORD
        keys = [(key + step) & 0xFFFFFFFF for key, step in zip(keys, KEY_STEPS, strict=True)]
    return np.stack([a, b, c, d], axis=-1)


def uniforms(
    first: Int64[ndarray, "n"], second: Int64[ndarray, "n"], attempt: int, seed: int, count: int
) -> Float64[ndarray, "count n"]:
    """``count`` numbers in the open interval (0, 1) for each pair of integers below 2^32."""
    blocks = []
    for block in range(-(-count // 4)):
        rest = [np.full(len(first), value) for value in (block, attempt)]
        counters = np.stack([first, second, *rest], axis=-1).astype(np.uint64)
        blocks.append(philox(counters, seed))
    return np.asarray((np.concatenate(blocks, axis=-1).T[:count] + 0.5) / 2.0**32)
