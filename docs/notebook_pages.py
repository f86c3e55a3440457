"""The notebooks as pages of the documentation site: text, code and the outputs that are stored in them."""

import base64
import json
import re
from collections.abc import Iterator
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
ENDINGS = {"image/png": "png", "image/jpeg": "jpg"}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook, and its pictures."""
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        pictures: dict[str, bytes] = {}
        text = "\n\n".join(_parts(path, pictures))
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=text))
        for name, content in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=content))
    return files


def on_page_markdown(markdown: str, **_: object) -> str:
    """Lead links to the notebooks' files, which the repository's pages have, to their pages here."""
    return re.sub(r"\]\(((?:\.\./)*)\.\./notebooks/(\w+)\.ipynb\)", r"](\1notebooks/\2.md)", markdown)


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
