"""The tables of options in the guides are those of the config files and their schemas."""

import importlib.util

import pytest
from docs_commands import ROOT

pytest.importorskip("mkdocs")
SPEC = importlib.util.spec_from_file_location("option_tables", ROOT / "docs" / "option_tables.py")
tables = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(tables)


@pytest.mark.parametrize("task", tables.GUIDES)
def test_a_guide_has_the_present_tables(task):
    text = (ROOT / "docs" / tables.GUIDES[task]).read_text("utf-8")
    assert tables.filled(task, text) == text, "python docs/option_tables.py writes them"


@pytest.mark.parametrize("task", tables.GUIDES)
def test_every_key_of_a_task_has_a_default_a_range_and_a_meaning(task):
    rows = [line.split(" | ") for line in tables.short_tables(task).splitlines() if line.startswith("| `task.")]
    assert len(rows) >= 4
    assert not [row for row in rows if len(row) != 4 or not all(cell.strip(" |") for cell in row)]


def test_what_a_schema_allows_is_said_in_words():
    rows = tables.short_tables("localization")
    assert "| `filter.ess_threshold` | `0.5` | >= 0 and <= 1 |" in rows
    assert "| `task.particle_counts` | `null` | list of >= 1 and <= 1e+06 or `null` |" in rows
    assert "**`office_walk`**" in rows
    assert "`digits`" not in rows  # a dataset of another task
