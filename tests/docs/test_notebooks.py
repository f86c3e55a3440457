"""The notebooks run from their first cell to their last, and show what they showed when they were stored."""

import json
import re

import pytest
from docs_commands import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def stored(path):
    return json.loads(path.read_text("utf-8"))["cells"]


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, monkeypatch):
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.setenv("PYTHONWARNINGS", "ignore")
    monkeypatch.delenv("SEXTANT_DATA", raising=False)
    notebook = nbformat.read(path, 4)
    NotebookClient(notebook, timeout=240, resources={"metadata": {"path": str(path.parent)}}).execute()
    kinds = [[output["output_type"] for output in cell.get("outputs", [])] for cell in notebook.cells]
    assert [set(each) for each in kinds] == [
        {output["output_type"] for output in cell.get("outputs", [])} for cell in stored(path)
    ]


def test_there_are_five():
    assert len(NOTEBOOKS) == 5


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_outputs_are_stored_without_errors_warnings_or_paths(path):
    code = [cell for cell in stored(path) if cell["cell_type"] == "code"]
    assert sum(bool(cell["outputs"]) for cell in code) >= 3
    outputs = [output for cell in code for output in cell["outputs"]]
    assert not [output for output in outputs if output["output_type"] == "error" or output.get("name") == "stderr"]
    assert not re.search(r"/(home|root|tmp|work)/", json.dumps([output.get("text", "") for output in outputs]))
    assert path.stat().st_size < 400_000


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_links_lead_to_pages_and_their_headings(path):
    for target in re.findall(
        r"\]\(([^)]+)\)", "".join("".join(c["source"]) for c in stored(path) if c["cell_type"] == "markdown")
    ):
        assert (path.parent / target.partition("#")[0]).is_file(), target


def test_readme_and_the_front_page_link_all():
    for page, folder in ((ROOT / "README.md", "notebooks/"), (ROOT / "docs" / "index.md", "../notebooks/")):
        text = page.read_text()
        for path in NOTEBOOKS:
            assert f"]({folder}{path.name})" in text, (page.name, path.stem)


def test_links_to_notebooks_lead_to_their_files_where_the_site_is_not_built():
    """The site leads them to its pages, and is built strictly."""
    links = [
        (page, target)
        for page in (ROOT / "docs").rglob("*.md")
        for target in re.findall(r"\]\(([^)]*notebooks/[^)]*)\)", page.read_text())
    ]
    assert len(links) >= 2 * len(NOTEBOOKS)
    assert [link for link in links if not (link[0].parent / link[1]).is_file()] == []
