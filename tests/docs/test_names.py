"""Files that pages and config files name exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [ROOT / "README.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("conf/**/*.yaml"), *ROOT.glob("src/**/*.py")]
)
#: a file of the checkout, not a pattern, and not one that a user has yet to write (``mine``, ``my_..``)
NAMED = re.compile(r"(?<![\w/.<])((?:conf|docs|examples|benchmarks|tests)/[\w/.-]+\.(?:py|md|yaml|geojson|jpg))\b")
OWN = re.compile(r"\bmine\b|/my_|/x\.")
#: written on the user's machine: by make gpu-check, by sextant claims
WRITTEN = ("docs/benchmarks_gpu.md",)


@pytest.mark.parametrize("folder", ["README.md", "docs", "conf", "src"])
def test_a_file_that_is_named_exists(folder):
    gone = [
        f"{page.relative_to(ROOT)}: {name}"
        for page in PAGES
        if page.relative_to(ROOT).parts[0] == folder
        for name in NAMED.findall(page.read_text(encoding="utf-8"))
        if not (ROOT / name).exists() and name not in WRITTEN and not OWN.search(name)
    ]
    assert not gone
