"""Philox against its published answers."""

import numpy as np
import pytest

from sextant.data.counters import philox, uniforms

# kat_vectors of the Random123 distribution, philox4x32 with 10 rounds: counter, key, answer
ANSWERS = [
    ([0, 0, 0, 0], (0, 0), [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
    ([0xFFFFFFFF] * 4, (0xFFFFFFFF, 0xFFFFFFFF), [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
    (
        [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
        (0xA4093822, 0x299F31D0),
        [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
    ),
]


@pytest.mark.parametrize(("counter", "key", "answer"), ANSWERS)
def test_known_answers(counter, key, answer):
    assert philox(np.array([counter], np.uint64), key[0] | key[1] << 32)[0].tolist() == answer


def test_uniforms_are_uniform_and_unrelated():
    u = uniforms(np.repeat(np.arange(100), 1000), np.tile(np.arange(1000), 100), 0, 7, 6)
    assert u.shape == (6, 100_000)
    assert u.min() > 0
    assert u.max() < 1
    for row in u:
        counts = np.histogram(row, 50, (0, 1))[0]
        assert ((counts - 2000) ** 2 / 2000).sum() < 86  # chi-squared of 49 degrees of freedom, p = 0.001
    assert np.abs(np.corrcoef(u) - np.eye(6)).max() < 0.015
    table = u[0].reshape(100, 1000)
    assert abs(np.corrcoef(table[:-1].ravel(), table[1:].ravel())[0, 1]) < 0.015  # neighbouring panoramas
    assert abs(np.corrcoef(table[:, :-1].ravel(), table[:, 1:].ravel())[0, 1]) < 0.015  # neighbouring draws


def test_seed_attempt_and_both_numbers_matter():
    def first(a, b, attempt, seed):
        return uniforms(np.array([a]), np.array([b]), attempt, seed, 1)[0, 0]

    values = [first(1, 2, 0, 3), first(2, 1, 0, 3), first(1, 2, 1, 3), first(1, 2, 0, 4), first(1, 2, 0, 3 + 2**32)]
    assert len(set(values)) == len(values)
