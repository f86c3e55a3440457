"""The pages of ``results/`` and the notebooks in the site, links between the shelves, and equations as MathML."""

import base64
import html
import json
import re
from collections.abc import Iterator
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
NOTEBOOKS = ROOT / "notebooks"
ENDINGS = {"image/png": "png", "image/jpeg": "jpg"}
#: what the site takes of the stored results: pages and pictures; tables as files where pages link to them
SHOWN = (".md", ".png", ".jpg", ".svg", ".csv", ".html")
#: what arithmatex leaves: inline in a span, displayed in a div
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the stored results, and a page for each notebook with its pictures."""
    for path in sorted((ROOT / "results").rglob("*.*")):
        if path.suffix in SHOWN:
            files.append(File.generated(config, path.relative_to(ROOT).as_posix(), abs_src_path=str(path)))
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        pictures: dict[str, bytes] = {}
        text = "\n\n".join(_parts(path, pictures))
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=text))
        for name, content in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=content))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Lead links between folders of the repository to their places in the site, whose root is ``docs``."""
    if page.file.src_uri.startswith("results/"):
        return re.sub(r"\]\(((?:\.\./)+)docs/", r"](\1", markdown)
    markdown = re.sub(r"\]\(((?:\.\./)*)\.\./results/", r"](\1results/", markdown)
    return re.sub(r"\]\(((?:\.\./)*)\.\./notebooks/(\w+)\.ipynb\)", r"](\1notebooks/\2.md)", markdown)


def on_page_content(content: str, **_: object) -> str:
    """Equations as MathML, which browsers draw without a script or a font from another host."""
    return EQUATION.sub(_drawn, content)


def _drawn(found: re.Match[str]) -> str:
    inline = found[2] == "("
    equation = convert(html.unescape(found[3]).strip(), display="inline" if inline else "block")
    return equation if inline else f'<div class="equation" tabindex="0">{equation}</div>'


def _parts(path: Path, pictures: dict[str, bytes]) -> Iterator[str]:
    """Markdown of the cells, in their order; pictures are collected by their names."""
    heading = None
    for number, cell in enumerate(json.loads(path.read_text("utf-8"))["cells"]):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            heading = next((line.lstrip("# ") for line in source.splitlines() if line.startswith("#")), heading)
            yield source.replace("](../docs/", "](../")
            continue
        yield f"```python\n{source}\n```"
        printed = ""
        for output in cell["outputs"]:
            data = output.get("data", {})
            kind = next((kind for kind in ENDINGS if kind in data), None)
            if kind is not None:
                name = f"{path.stem}_{number}.{ENDINGS[kind]}"
                pictures[name] = base64.b64decode("".join(data[kind]))
                yield f"![{heading}]({name})"
            else:
                printed += "".join(output.get("text", data.get("text/plain", "")))
        if printed:
            yield f"```text\n{printed.rstrip()}\n```"
