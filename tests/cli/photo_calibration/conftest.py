"""Figures take most of the time: only tests that ask for them draw any."""

import pytest


@pytest.fixture(autouse=True)
def drawn(request, monkeypatch):
    """Draw nothing unless the test takes ``figures``."""
    if "figures" in request.fixturenames:
        return
    for module in ("applications.calibration.photo_files", "figures.style"):
        monkeypatch.setattr(
            f"sextant.{module}.save_figure", lambda figure, folder, name: (folder / f"{name}.png").touch()
        )


@pytest.fixture
def figures():
    """Ask for real figures."""
