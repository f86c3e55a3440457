"""Positions that no robot and no camera has."""

from collections.abc import Sequence

#: No robot goes further than that, in any unit; of much larger numbers nothing can be computed.
FURTHEST = 1e9


def too_far(position: Sequence[float]) -> str:
    """What is wrong with a position further away than any robot goes; "" if it is not.

    >>> too_far([0.0, -1e160, 5.0])
    'the position (0, -1e+160, 5) is further away than 1e+09'
    """
    if all(abs(value) <= FURTHEST for value in position):
        return ""
    return f"the position ({', '.join(f'{value:g}' for value in position)}) is further away than {FURTHEST:g}"
