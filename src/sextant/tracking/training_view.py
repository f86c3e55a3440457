"""MLflow's server, whose pages open in the view for model training.

MLflow 3.17 keeps the view in the browser (``localStorage``), and its links omit it. Without a stored choice every page
opens in the view for language models, with *Evaluation runs* in place of runs. :data:`app` therefore adds to the start
page a script that stores these choices unless the user has made others, and style rules for descriptions, in whose
tables MLflow leaves no space between columns. It is an MLflow plug-in of the group ``mlflow.app``, which :func:`main`
registers for its own process only.
"""

import json
import sys
from collections.abc import Awaitable, Callable, MutableMapping, Sequence
from importlib.metadata import EntryPoint
from typing import Any, cast

#: keys of MLflow's pages in ``localStorage``: the view, no panel of the assistant, no usage data
CHOICES = {
    "mlflow.workflowType_v1": "machine_learning",
    "mlflow.assistant.fab.autoOpenedOnFirstLoad_v1": True,
    "mlflow.settings.telemetry.enabled_v1": False,
    "mlflow.telemetry.info.alert.dismissed_v1": True,
}
#: in descriptions: tables with lines and space, and pictures and commands no wider than the page
RULES = """
table:not([class]) :is(th, td) {
  padding: 3px 14px 3px 0; text-align: left; border-bottom: 1px solid color-mix(in srgb, currentColor 20%, transparent);
}
.note-editor-preview-content img { max-width: 100%; }
.note-editor-preview-content pre { white-space: pre-wrap; overflow-wrap: anywhere; }
"""
PLUG_IN = EntryPoint("sextant", "sextant.tracking.training_view:app", "mlflow.app")
Message = MutableMapping[str, Any]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[..., Awaitable[None]]


def adapted(page: bytes) -> bytes:
    """A page that first stores :data:`CHOICES` in the browser, and has :data:`RULES`.

    >>> adapted(b"<html><head></head></html>")[:20]
    b'<html><head><script>'
    """
    keep = "localStorage.getItem(key) ?? localStorage.setItem(key, JSON.stringify(value))"
    script = f"<script>for (const [key, value] of Object.entries({json.dumps(CHOICES)})) {keep}</script>"
    return page.replace(b"<head>", f"<head>{script}<style>{RULES}</style>".encode(), 1)


class TrainingView:
    """An ASGI application that adapts the start page of another and passes on everything else.

    Args:
        load: returns the other application; called with the first request, as importing MLflow's takes seconds.
    """

    def __init__(self, load: Callable[[], Application]):
        self.load = load

    async def __call__(self, scope: Message, receive: Callable[[], Awaitable[Message]], send: Send) -> None:
        """Answer one request."""
        is_start = scope["type"] == "http" and scope["path"] == "/" and scope["method"] == "GET"
        inner = self.load()
        await inner(_unconditional(scope) if is_start else scope, receive, _Changed(send) if is_start else send)


def _unconditional(scope: Message) -> Message:
    """A request without conditions, which a copy of the original page in the browser's cache would satisfy."""
    kept = [(name, value) for name, value in scope["headers"] if not name.lower().startswith(b"if-")]
    return {**scope, "headers": kept}


class _Changed:
    """Collects an answer, and sends it changed and uncached once it is complete."""

    def __init__(self, send: Send):
        self.send, self.start, self.body = send, dict[str, Any](), b""

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.start = dict(message)
            return
        self.body += message.get("body", b"")
        if not message.get("more_body", False):
            body = adapted(self.body)
            changed = (b"content-length", b"etag", b"last-modified", b"cache-control")
            kept = [(name, value) for name, value in self.start["headers"] if name.lower() not in changed]
            fresh = [(b"content-length", str(len(body)).encode()), (b"cache-control", b"no-store")]
            await self.send({**self.start, "headers": [*kept, *fresh]})
            await self.send({**message, "body": body})


def _mlflow() -> Application:
    from mlflow.server.fastapi_app import app as inner

    return cast(Application, inner)


#: MLflow's server with the adapted start page
app = TrainingView(_mlflow)


def main(arguments: Sequence[str]) -> None:
    """Run ``mlflow`` with these arguments; ``--app-name sextant`` selects :data:`app`."""
    from mlflow.utils import plugins

    installed = plugins.get_entry_points
    plugins.get_entry_points = lambda group: [*installed(group), *([PLUG_IN] if group == PLUG_IN.group else [])]
    from mlflow.cli import cli

    cli(list(arguments))


if __name__ == "__main__":
    main(sys.argv[1:])
