"""The reference pages of the documentation site, made when it is built: the public names, then one page a package."""

import ast
from pathlib import Path
from types import ModuleType

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

import sextant
from sextant import applications

SOURCE = Path(__file__).parents[1] / "src"
#: the packages that are imported by people; the others serve the command line
PACKAGES = (
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


#: how the page of the public names begins
PUBLIC = """# sextant

The names of `sextant` are imported on first use and need no config: `sextant.PhotoCalibrator`, `sextant.run`. Those of
`sextant.applications` below them are what their methods return."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages into the navigation."""
    assert config.nav is not None
    pages = [{"sextant": "api/sextant.md"}, *({f"sextant.{package}": f"api/{package}.md"} for package in PACKAGES)]
    config.nav.append({"API": pages})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page of what ``sextant`` itself offers, and one for each package: its names, or those of its modules."""
    results = [name for name in applications.__all__ if name not in sextant.LAZY]
    public = [*(_entry(sextant, name) for name in sextant.LAZY), *(_entry(applications, name) for name in results)]
    files.append(File.generated(config, "api/sextant.md", content="\n\n".join([PUBLIC, *public])))
    for package in PACKAGES:
        text = "".join(_sections(SOURCE / "sextant" / package))
        files.append(File.generated(config, f"api/{package}.md", content=f"# sextant.{package}\n\n{text}"))
    return files


def _entry(module: ModuleType, name: str) -> str:
    """A heading by the name under which it is imported, and the reference of where it is defined."""
    offered = getattr(module, name)
    path = f"{offered.__module__}.{offered.__qualname__}"
    return f"## {module.__name__}.{name}\n\n::: {path}\n    options: {{show_root_heading: false, heading_level: 3}}"


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
