"""Figures take most of the time: only tests that ask for them draw any."""

import pytest


@pytest.fixture(autouse=True)
def drawn(request, monkeypatch):
    """Draw nothing unless the test takes ``figures``."""
    if "figures" in request.fixturenames:
        return
    monkeypatch.setattr(
        "sextant.figures.style.save_figure", lambda figure, folder, name: (folder / f"{name}.png").touch()
    )


@pytest.fixture
def figures():
    """Ask for real figures."""
