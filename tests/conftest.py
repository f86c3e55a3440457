"""What all tests share: reproducible property tests, and the folder of real data."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault("OMP_NUM_THREADS", "1")  # read when torch is imported; the workers of pytest-xdist fill the cores
settings.register_profile("sextant", max_examples=25, deadline=None, derandomize=True)
settings.load_profile("sextant")


@pytest.fixture(scope="session")
def real_data():
    """The folder named by SEXTANT_DATA."""
    if not os.environ.get("SEXTANT_DATA"):
        pytest.skip("SEXTANT_DATA does not name a folder with real data")
    folder = Path(os.environ["SEXTANT_DATA"])
    if not folder.is_dir():
        pytest.fail(f"SEXTANT_DATA={folder} is not a folder")
    return folder
