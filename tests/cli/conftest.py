"""What the tests of commands share."""

import pytest

from sextant import cli


@pytest.fixture
def photos(office, tmp_path):
    """The frames of a drive through the small office, as files."""
    return office.photos(tmp_path / "photos")


@pytest.fixture
def run_verb(capsys):
    """Run a verb; returns its exit status and what was said."""

    def run(name, *arguments):
        status = 0
        try:
            cli.run(name, list(arguments))
        except SystemExit as ended:
            status = ended.code
        said = capsys.readouterr()
        return status, said.out + said.err

    return run
