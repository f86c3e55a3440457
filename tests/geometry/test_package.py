"""What the package is worth alone."""

import subprocess
import sys


def test_it_is_usable_without_any_framework():
    frameworks = (
        "pytorch_lightning",
        "hydra",
        "omegaconf",
        "mlflow",
        "torchvision",
        "matplotlib",
        "sklearn",
        "pydantic",
    )
    code = f"import sys, sextant.geometry; print([name for name in {frameworks} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
