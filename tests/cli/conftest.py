"""What the tests of commands that localize share."""

import pytest


@pytest.fixture
def photos(office, tmp_path):
    """The frames of a drive through the small office, as files."""
    return office.photos(tmp_path / "photos")
