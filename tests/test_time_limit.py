"""A test that takes long and is not marked slow is warned of; compiling a kernel for the first time is not counted."""

import subprocess
import sys
import time
import warnings

import joblib
import numba
import pytest
from time_limit import end_workers, time_limit


def work(seconds):
    start = time.process_time()
    while time.process_time() - start < seconds:
        pass


def test_work_of_its_own_counts():
    told = r"took 0\.\d CPU seconds, at most 0\.2: shorten it, or mark it slow"
    with pytest.warns(pytest.PytestWarning, match=told), time_limit(0.2):
        work(0.3)


def test_work_of_a_child_counts():
    code = "import time\nwhile time.process_time() < 0.4: pass"
    with pytest.warns(pytest.PytestWarning), time_limit(0.3):
        subprocess.run([sys.executable, "-S", "-c", code], check=True)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_waiting_and_compiling_do_not_count():
    numba.njit(lambda x: x + 1)(1)  # what the compiler sets up once
    with time_limit(0.2):
        time.sleep(0.3)
        numba.njit(lambda x: sum([x**k for k in range(5)]))(1.5)


@pytest.mark.slow
def test_workers_count_where_they_worked():
    def ends_its_workers():
        joblib.Parallel(2)(joblib.delayed(work)(1.5) for _ in range(2))
        end_workers()

    with pytest.warns(pytest.PytestWarning), time_limit(2.0):
        ends_its_workers()
    with warnings.catch_warnings(), time_limit(2.0):  # there are new ones
        warnings.simplefilter("error")
        assert joblib.Parallel(2)(joblib.delayed(abs)(-x) for x in range(2)) == [0, 1]


def test_an_error_within_stays_what_it_is():
    def fails_late():
        work(0.01)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), time_limit(0.0):
        fails_late()
