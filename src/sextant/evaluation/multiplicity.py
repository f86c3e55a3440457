"""Correction of p-values for the number of tests in a family."""

from collections.abc import Sequence

import numpy as np


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's step-down adjusted p-values (Holm 1979); nan entries stay nan and do not count as tests."""
    from statsmodels.stats.multitest import multipletests

    values = np.asarray(p_values, float)
    tested = ~np.isnan(values)
    adjusted = np.full_like(values, np.nan)
    if tested.any():
        adjusted[tested] = multipletests(values[tested], method="holm")[1]
    return [float(p) for p in adjusted]
