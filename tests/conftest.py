"""What all tests share: reproducible property tests, real data, the limit of a test's length, who runs which file."""

import os
from contextlib import nullcontext
from pathlib import Path

import pytest
from hypothesis import settings
from threadpoolctl import threadpool_limits
from time_limit import end_workers, time_limit
from xdist.scheduler import LoadScopeScheduling

# The workers of pytest-xdist fill the cores. Torch reads this when it is imported; plugins have imported NumPy already.
threadpool_limits(int(os.environ.setdefault("OMP_NUM_THREADS", "1")))
settings.register_profile("sextant", max_examples=25, deadline=None, derandomize=True)
settings.load_profile("sextant")

#: Files that share a trained run, which is made when it is first asked for: one worker runs them all.
TOGETHER = {
    "tests/applications/localization/test_localizer.py": "a run in the office",
    "tests/cli/test_predict_localization.py": "a run in the office",
    "tests/cli/test_localize.py": "a run in the office",
    "tests/tasks/cosfire/test_cosfire.py": "a run on the digits",
    "tests/cli/test_predict_cosfire.py": "a run on the digits",
}


class FileByFile(LoadScopeScheduling):
    """A worker takes a file, so that what the file's tests share is made once; in the order of collection."""

    def _split_scope(self, nodeid):
        file = nodeid.partition("::")[0]
        return TOGETHER.get(file, file)


def pytest_xdist_make_scheduler(config, log):
    config.option.loadscopereorder = False
    return FileByFile(config, log)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Tests that start a cluster run only where they are asked for. Files with slow tests come first: none of them is
    left for one worker at the end.
    """
    if "cluster" not in config.option.markexpr:
        config.hook.pytest_deselected(items=[item for item in items if item.get_closest_marker("cluster")])
        items[:] = [item for item in items if not item.get_closest_marker("cluster")]
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    with nullcontext() if item.get_closest_marker("slow") else time_limit():
        try:
            return (yield)
        finally:
            end_workers()


@pytest.fixture(scope="session", autouse=True)
def cache_of_the_tests(tmp_path_factory):
    """Converted weights, MLflow's empty tables and rendered offices are made once for all workers of pytest-xdist, and
    not in the folder of whoever runs the tests.
    """
    own = tmp_path_factory.getbasetemp()
    os.environ["SEXTANT_CACHE"] = str((own.parent if os.environ.get("PYTEST_XDIST_WORKER") else own) / "cache")


@pytest.fixture(scope="session", autouse=True)
def composed_once():
    """Tests of one process read the config files of each choice of options once."""
    from sextant.composing.compose import composing_many

    with composing_many():
        yield


@pytest.fixture(scope="session")
def office(tmp_path_factory):
    """A finished run in a small office, and a drive in it."""
    from tiny_office import office_run

    return office_run(tmp_path_factory)


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    """A folder for runs that the tests of a file share."""
    return tmp_path_factory.mktemp("outputs")


@pytest.fixture(scope="session")
def real_data():
    """The folder named by SEXTANT_DATA."""
    if not os.environ.get("SEXTANT_DATA"):
        pytest.skip("SEXTANT_DATA does not name a folder with real data")
    folder = Path(os.environ["SEXTANT_DATA"])
    if not folder.is_dir():
        pytest.fail(f"SEXTANT_DATA={folder} is not a folder")
    return folder
