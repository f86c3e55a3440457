import subprocess
import sys

import pytest

from benchmarks.house import circles

HEAVY = ("pytorch_lightning", "hydra", "omegaconf", "mlflow", "rich", "torchvision", "matplotlib")


def test_no_module_imports_itself_through_others_or_through_their_packages():
    """So each can be imported first."""
    assert circles() == []


@pytest.mark.slow
def test_nothing_is_imported_before_it_is_needed():
    """One process imports more and more; each line is what of the unwanted is there by then."""
    program = f"""
import importlib, pkgutil, sys
def show(*unwanted):
    print([name for name in unwanted if name in sys.modules])
import sextant
show("torch", "numpy")
import sextant.corruptions
show("cv2", "numba", "skimage", "scipy")
import sextant.localization.observation
show("numba", "gpytorch")
for name in ("sextant.applications", "sextant.kit"):
    for module in pkgutil.walk_packages(importlib.import_module(name).__path__, name + "."):
        importlib.import_module(module.name)
show(*{HEAVY})
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[]"] * 4
