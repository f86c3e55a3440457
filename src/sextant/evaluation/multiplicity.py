"""Correction of p-values for the number of tests in a family."""

from collections.abc import Sequence

import numpy as np


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's step-down adjusted p-values; nan entries stay nan and do not count as tests.

    Of n tests, the i-th smallest p is multiplied by n - i + 1, and adjusted values never decrease with p. It is written
    out here because statsmodels' ``multipletests`` runs garbage collection on every call, which takes longer than
    everything else.

    Source: S. Holm, A simple sequentially rejective multiple test procedure, Scand. J. Statistics 6, 1979.

    >>> holm([0.01, 0.04, 0.03])  # times 3, 1 and 2; the largest no less than the one before it
    [0.03, 0.06, 0.06]
    """
    values = np.asarray(p_values, float)
    tested = np.flatnonzero(~np.isnan(values))
    order = tested[np.argsort(values[tested])]
    adjusted = np.full_like(values, np.nan)
    scaled = values[order] * np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(scaled), 1)
    return [float(p) for p in adjusted]
