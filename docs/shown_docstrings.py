"""Docstrings as the documentation site shows them: roles as links, examples as code."""

import re

import griffe

ROLE = re.compile(r":(?:class|func|meth|mod|attr|data|exc|obj):`~?([\w.]+)`")
EXAMPLE = re.compile(r"^>>> .*(?:\n.+)*", re.MULTILINE)


class ShownDocstrings(griffe.Extension):
    """``:func:`sextant.run``` becomes a link where the site has the name, and code where it does not."""

    def on_instance(self, *, obj: griffe.Object, **kwargs: object) -> None:
        """Rewrite the docstring of whatever was read."""
        if obj.docstring:
            shown = ROLE.sub(_link, obj.docstring.value)
            obj.docstring.value = EXAMPLE.sub(lambda found: f"```pycon\n{found[0]}\n```", shown)


def _link(role: re.Match[str]) -> str:
    name = role[1].rsplit(".", 1)[-1]
    return f"<autoref identifier='{role[1]}' optional><code>{name}</code></autoref>"
