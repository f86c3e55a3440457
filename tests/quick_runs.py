"""What runs of a second or two spend most of their time on otherwise: reading config files, and laying out figures."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from sextant.composing.compose import composing_many


def draw(figure: Figure, folder: Path, name: str) -> list[Path]:
    """In place of ``save_figure``: all is drawn, coarsely and not laid out. That it is, tests/figures shows."""
    folder.mkdir(parents=True, exist_ok=True)
    figure.set_layout_engine("none")
    figure.savefig(path := folder / f"{name}.png", dpi=50)
    return [path]


@pytest.fixture(scope="module", autouse=True)
def quick_runs():
    """Config files are read once for each choice of options, as in a sweep; ``draw`` draws the figures of runs."""
    with composing_many(), pytest.MonkeyPatch.context() as patch:
        patch.setattr("sextant.lifecycle.training.save_figure", draw)
        yield
