"""How long a test may take that is not marked ``slow``."""

import math
import os
import sys
import warnings
from contextlib import contextmanager

import pytest
from numba.core.event import install_timer

#: no limit for as many examples as somebody asked for
LONGEST_S = math.inf if "SEXTANT_EXAMPLES" in os.environ else 5.0


def cpu_seconds():
    """Of this process and of the children that it has waited for; what other processes do costs a test nothing."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


@contextmanager
def time_limit(longest_s=LONGEST_S):
    """Warn of a test that takes longer. It does not fail, since other work on the machine can triple its CPU seconds.
    Compiling a kernel is not counted: no test chose to be the first to need it.
    """
    compiling, before = [0.0], cpu_seconds()
    with install_timer("numba:compile", compiling.append):
        yield
    spent = cpu_seconds() - before - sum(compiling)
    told = f"took {spent:.1f} CPU seconds, at most {longest_s:g}: shorten it, or mark it slow"
    if spent > longest_s:
        warnings.warn(pytest.PytestWarning(told), stacklevel=2)


def end_workers():
    """End the workers that wait for more work: their time would count in the test during which they end."""
    loky = sys.modules.get("joblib.externals.loky.reusable_executor")
    if loky is not None and loky._executor is not None:
        loky._executor.shutdown(wait=True)
    ours = sys.modules.get("sextant.lifecycle.launchers.processes")
    if ours is not None:
        ours.end_idle()
