"""The distribution as users install it: a wheel that holds configs, models and pages, outside of the checkout."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import sextant

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder into which the wheel is installed, alone."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    assert wheel.name == f"sextant_vision-{sextant.__version__}-py3-none-any.whl"
    subprocess.run([sys.executable, "-m", "zipfile", "-e", str(wheel), str(folder / "lib")], check=True)
    return folder / "lib"


def run(installed, tmp_path, program):
    """What a program prints whose ``sextant`` is that of the wheel."""
    environment = os.environ | {"PYTHONPATH": str(installed), "SEXTANT_OUTPUTS": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_command_composes_configs_from_the_wheel(installed, tmp_path):
    program = "import sextant; from sextant.cli import run; print(sextant.__file__); run('train', ['--cfg', 'job'])"
    where, printed = run(installed, tmp_path, program).split("\n", 1)
    assert where.startswith(str(installed))
    assert "sextant.models.LeNet" in printed


def test_a_model_of_the_package_is_in_the_wheel(installed, tmp_path):
    program = (
        "import numpy as np, sextant; camera = sextant.PhotoCalibrator.load('zoo:calibration').calibrate("
        "np.random.default_rng(0).integers(0, 255, (120, 160, 3), np.uint8)); print(camera.verdict)"
    )
    assert run(installed, tmp_path, program).strip() in ("good", "weak", "not trustworthy")


def test_the_version_is_the_same_everywhere():
    assert f"version: {sextant.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"## {sextant.__version__}" in (ROOT / "CHANGELOG.md").read_text()
    assert f'version = "{sextant.__version__}"' in (ROOT / "pyproject.toml").read_text()
