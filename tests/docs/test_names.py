"""Files, modules and what is in them that pages, config files and docstrings name exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [
        ROOT / "README.md",
        *(path for shelf in ("docs", "results") for path in ROOT.glob(f"{shelf}/**/*.md")),
        *ROOT.glob("conf/**/*.yaml"),
        *ROOT.glob("src/**/*.py"),
    ]
)
#: a file of the checkout, not a pattern, and not one that a user has yet to write (``mine``, ``my_..``)
NAMED = re.compile(
    r"(?<![\w/.<])((?:conf|docs|results|lab|examples|benchmarks|tests)/[\w/.-]+\.(?:py|md|yaml|geojson|jpg))\b"
)
OWN = re.compile(r"\bmine\b|/my_|/x\.")
#: in a docstring a reference; the parts that config files name are built by tests/configs
REFERENCE, MENTIONED = (
    re.compile(r":\w+:`~?sextant((?:\.\w+)+)`"),
    re.compile(r"(?<![\w/.@-])sextant((?:\.[A-Za-z_]\w*)+)"),
)
#: written by the reader of docs/adding.md
YET_TO_WRITE = "sextant.losses.CircleLoss"
#: written on the user's machine: by make gpu-check, by sextant claims
WRITTEN = ("results/benchmarks_gpu.md",)


@pytest.mark.parametrize("folder", ["README.md", "docs", "results", "conf", "src"])
def test_a_file_that_is_named_exists(folder):
    gone = [
        f"{page.relative_to(ROOT)}: {name}"
        for page in PAGES
        if page.relative_to(ROOT).parts[0] == folder
        for name in NAMED.findall(page.read_text(encoding="utf-8"))
        if not (ROOT / name).exists() and name not in WRITTEN and not OWN.search(name)
    ]
    assert not gone


def is_there(dotted):
    """Whether the module of a dotted name exists, and holds the word that follows it."""
    place = ROOT / "src" / "sextant"
    for part in dotted.split(".")[1:]:
        inner = next((path for path in (place / part, place / f"{part}.py") if path.exists()), None)
        if inner is None:
            source = place if place.is_file() else place / "__init__.py"
            return source.is_file() and bool(re.search(rf"\b{part}\b", source.read_text(encoding="utf-8")))
        place = inner
    return True


@pytest.mark.parametrize(
    ("folder", "pattern"),
    [("README.md", MENTIONED), ("docs", MENTIONED), ("results", MENTIONED), ("src", REFERENCE)],
)
def test_a_module_that_is_named_exists_with_what_is_named_in_it(folder, pattern):
    named = [
        (page.relative_to(ROOT), f"sextant{found}")
        for page in PAGES
        if page.relative_to(ROOT).parts[0] == folder
        for found in pattern.findall(page.read_text(encoding="utf-8"))
    ]
    assert named
    assert not [(str(page), name) for page, name in named if name != YET_TO_WRITE and not is_there(name)]


def test_a_module_that_is_gone_is_noticed():
    assert is_there("sextant.layers.PushPullInhibition")
    assert not is_there("sextant.chapters.places.cli.gallery_pages")
    assert not is_there("sextant.layers.PushPullInhibitor")
