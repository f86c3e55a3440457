"""Detect implausible positions of robots and cameras."""

from collections.abc import Sequence

#: No robot goes further than this, in any unit; much larger numbers break computations.
FURTHEST = 1e9


def too_far(position: Sequence[float]) -> str:
    """The problem with an implausibly far position; "" if there is none.

    >>> too_far([0.0, -1e160, 5.0])
    'the position (0, -1e+160, 5) is further away than 1e+09'
    """
    if all(abs(value) <= FURTHEST for value in position):
        return ""
    return f"the position ({', '.join(f'{value:g}' for value in position)}) is further away than {FURTHEST:g}"
