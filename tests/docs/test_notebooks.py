"""The notebooks run from their first cell to their last, and show what they showed when they were stored."""

import json
import os
import re

import pytest
from docs_commands import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def stored(path):
    return json.loads(path.read_text("utf-8"))["cells"]


@pytest.fixture(scope="module")
def kernel():
    """One for all: what a notebook imports is read once, and its names are forgotten before the next one runs."""
    from jupyter_client.manager import AsyncKernelManager
    from nbclient.util import run_sync

    given = {name: value for name, value in os.environ.items() if name != "SEXTANT_DATA"} | {"PYTHONWARNINGS": "ignore"}
    manager = AsyncKernelManager(kernel_name="python3")
    run_sync(manager.start_kernel)(cwd=str(ROOT / "notebooks"), env=given)
    yield manager
    run_sync(manager.shutdown_kernel)(now=True)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, kernel):
    import nbformat
    from nbclient import NotebookClient

    forgets = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("%reset -f")])
    for notebook in (forgets, nbformat.read(path, 4)):
        NotebookClient(notebook, km=kernel, timeout=240).execute()
    kinds = [[output["output_type"] for output in cell.get("outputs", [])] for cell in notebook.cells]
    assert [set(each) for each in kinds] == [
        {output["output_type"] for output in cell.get("outputs", [])} for cell in stored(path)
    ]


def test_there_are_six():
    assert len(NOTEBOOKS) == 6


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
        for shelf in ("docs", "results")
        for page in (ROOT / shelf).rglob("*.md")
        for target in re.findall(r"\]\(([^)]*notebooks/[^)]*)\)", page.read_text())
    ]
    assert len(links) >= 2 * len(NOTEBOOKS)
    assert [link for link in links if not (link[0].parent / link[1]).is_file()] == []
