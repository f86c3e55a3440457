"""A text with tables and charts as one self-contained HTML page."""

import base64
import hashlib
import html
import itertools
import json
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from sextant.figures.charts import Spec

if TYPE_CHECKING:
    from markdown_it.token import Token

#: charts that replace a picture, by the picture's name without folder and suffix
Charts = Mapping[str, Sequence[Spec]]

#: the only HTML allowed in a text: anchors for links within the page, and what is shown once its summary is clicked
ALLOWED = r'<a name="[\w-]+">|</a>|<details><summary>[\w ,.()-]+</summary>|</details>'
#: where a long name such as ``R@1_5m_night_to_noon`` may go on in the next line
PART = r"(?<=\w_)(?=\w)|(?<=\w[/=])(?=[A-Za-z])"
KINDS = {".png": "image/png", ".svg": "image/svg+xml"}
HINT = (
    "Headings sort a table. In a chart the pointer shows the numbers, a click on the legend shows one kind alone, "
    "dragging moves, the wheel with Shift enlarges, and a double click takes both back."
)


def html_page(title: str, text: str, charts: Charts, pictures: Path | None = None) -> str:
    """Render Markdown as an HTML page.

    The page loads nothing, and its content security policy allows only its own two scripts, by their hashes, so that
    nothing in the text can run.

    Args:
        title: title of the page.
        text: Markdown; links to other files become plain text, as the page stands alone.
        charts: charts that replace pictures.
        pictures: folder of the other pictures, which are embedded in the page.

    Returns:
        HTML; the same arguments give the same page.

    Example:
        >>> page = html_page("Runs", "| arm |\\n| --- |\\n| a |\\n", {})  # doctest: +SKIP
    """
    data: list[str] = []
    body = _body(text, charts, pictures, data)
    scripts = [vega(), _own("page.js")]
    allowed = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'" for s in scripts)
    policy = (
        f"default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src {allowed}"
    )
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{html.escape(title)}</title>\n<style>\n{_own('page.css')}</style>\n</head>\n<body>",
            f'{body}\n<p class="hint">{HINT}</p>',
            *data,
            *(f"<script>{script}</script>" for script in scripts),
            "</body>\n</html>\n",
        ]
    )


@cache
def vega() -> str:
    """Vega, Vega-Lite and Vega-Embed as one script."""
    import vl_convert

    bundle = vl_convert.javascript_bundle()  # type: ignore[call-arg]  # its stub asks for what has a default
    return bundle.replace("</script", "<\\/script")


def _body(text: str, charts: Charts, pictures: Path | None, data: list[str]) -> str:
    from markdown_it import MarkdownIt

    parser = MarkdownIt("commonmark").enable("table")
    tokens = parser.parse(text)
    for token in tokens:
        if token.type == "inline":
            token.children = [_standing_alone(child) for child in token.children or []]

    def image(self: object, found: "Sequence[Token]", number: int, options: object, env: object) -> str:
        name = Path(str(found[number].attrs["src"]))
        return _picture(name, found[number].content, charts.get(name.stem), pictures, data)

    def markup(self: object, found: "Sequence[Token]", number: int, options: object, env: object) -> str:
        content = found[number].content
        return content if re.fullmatch(ALLOWED, content.strip()) else html.escape(content)

    parser.add_render_rule("html_inline", markup)
    parser.add_render_rule("html_block", markup)
    parser.add_render_rule("image", image)

    def words(self: object, found: "Sequence[Token]", number: int, options: object, env: object) -> str:
        return re.sub(PART, "<wbr>", html.escape(found[number].content))

    def table(self: object, found: "Sequence[Token]", number: int, options: object, env: object) -> str:
        heading = itertools.takewhile(lambda token: token.type != "thead_close", found[number:])
        columns = sum(token.type == "th_open" for token in heading)
        return f'<div class="table"><table style="--columns: {columns}">\n'

    parser.add_render_rule("text", words)
    parser.add_render_rule("table_open", table)
    parser.add_render_rule("table_close", lambda *_: "</table></div>\n")
    return str(parser.renderer.render(tokens, parser.options, {}))


def _standing_alone(token: "Token") -> "Token":
    """The token, without its attributes if it links to another file."""
    if token.type == "link_open" and not str(token.attrs["href"]).startswith(("#", "http://", "https://")):
        token.attrs = {}
    return token


def _picture(name: Path, alt: str, specs: Sequence[Spec] | None, folder: Path | None, data: list[str]) -> str:
    if specs is not None:
        places = []
        for spec in specs:
            key = f"chart{len(data)}"
            said = json.dumps(spec, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
            data.append(f'<script type="application/json" id="{key}">{said}</script>')
            places.append(f'<span class="chart" style="display:block" data-chart="{key}"></span>')
        return "".join(places)
    path = None if folder is None else folder / name.name
    if path is None or not path.is_file():
        return html.escape(alt)
    encoded = base64.b64encode(path.read_bytes()).decode()
    return f'<img alt="{html.escape(alt)}" src="data:{KINDS[path.suffix]};base64,{encoded}">'


def _own(name: str) -> str:
    return (Path(__file__).parent / name).read_text("utf-8")
