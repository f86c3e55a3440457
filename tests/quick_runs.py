"""What runs of a second or two spend most of their time on otherwise: laying out figures."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure


def draw(figure: Figure, folder: Path, name: str) -> list[Path]:
    """In place of ``save_figure``: all is drawn, coarsely and not laid out. That it is, tests/figures shows."""
    folder.mkdir(parents=True, exist_ok=True)
    figure.set_layout_engine("none")
    figure.savefig(path := folder / f"{name}.png", dpi=50)
    return [path]


@pytest.fixture(scope="module", autouse=True)
def quick_runs():
    """``draw`` draws the figures of runs in this process.

    As they are for users, tests/docs/test_run_commands.py has them for three tasks, tests/cli/test_calibration.py and
    tests/cli/test_place_factors.py for the others.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sextant.lifecycle.training.save_figure", draw)
        yield
