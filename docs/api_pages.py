"""The reference pages of the documentation site: one a package, made when the site is built."""

import ast
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

SOURCE = Path(__file__).parents[1] / "src"
#: the packages that are imported by people; the others serve the command line
PACKAGES = (
    "applications",
    "geometry",
    "layers",
    "corruptions",
    "losses",
    "retrieval",
    "models",
    "baselines",
    "localization",
    "evaluation",
    "worlds",
    "lifecycle",
)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages into the navigation."""
    assert config.nav is not None
    config.nav.append({"API": [{f"sextant.{package}": f"api/{package}.md"} for package in PACKAGES]})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each package: its names, or those of its modules where it offers none itself."""
    for package in PACKAGES:
        text = "".join(_sections(SOURCE / "sextant" / package))
        files.append(File.generated(config, f"api/{package}.md", content=f"# sextant.{package}\n\n{text}"))
    return files


def _sections(folder: Path):
    """What mkdocstrings is asked for: a package that lists its names, else each module and package below it."""
    names = ".".join(folder.relative_to(SOURCE).parts)
    if _lists_names(folder / "__init__.py"):
        yield f"::: {names}\n    options: {{show_root_toc_entry: false, show_root_heading: false}}\n\n"
        folders = sorted(path for path in folder.iterdir() if (path / "__init__.py").is_file())
        for below in folders:
            yield f"## {names}.{below.name}\n\n"
            yield from _sections(below)
        return
    for path in sorted(folder.iterdir()):
        if (path / "__init__.py").is_file():
            yield f"## {names}.{path.name}\n\n"
            yield from _sections(path)
        elif path.suffix == ".py" and not path.stem.startswith("_"):
            yield f"::: {names}.{path.stem}\n\n"


def _lists_names(init: Path) -> bool:
    assigned = [node for node in ast.parse(init.read_text("utf-8")).body if isinstance(node, ast.Assign)]
    return any(getattr(a.targets[0], "id", "") == "__all__" and isinstance(a.value, ast.List) for a in assigned)
