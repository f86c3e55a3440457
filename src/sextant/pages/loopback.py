"""Serving a page on a loopback port: only this machine can reach it, and only the page itself may send requests."""

import base64
import hashlib
import logging
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

from flask import Flask, Response, jsonify, request
from werkzeug.serving import BaseWSGIServer, make_server

from sextant.errors import UserError

HOST = "127.0.0.1"
#: host names by which a browser may address this machine; any other name means that a foreign page was made to resolve
#: to this machine (DNS rebinding)
HOSTS = (HOST, "localhost", "[::1]")


def page_app(name: str, file: Path, replace: dict[str, str] | None = None) -> Flask:
    """An application with one page, which may run its own script and query its own server, and load nothing else.

    Args:
        name: name of the application.
        file: HTML with one ``<script>`` and one ``<style>``.
        replace: strings of the page and their replacements.
    """
    text = file.read_text("utf-8")
    for word, meant in (replace or {}).items():
        text = text.replace(word, meant)
    script, style = (re.search(rf"<{tag}>(.*?)</{tag}>", text, re.DOTALL) for tag in ("script", "style"))
    assert script is not None
    assert style is not None
    own = [base64.b64encode(hashlib.sha256(each[1].encode()).digest()).decode() for each in (script, style)]
    policy = (
        f"default-src 'none'; script-src 'sha256-{own[0]}'; style-src 'sha256-{own[1]}'; img-src data: blob:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    app = Flask(name, static_folder=None)
    app.json.sort_keys = False  # type: ignore[attr-defined]
    app.before_request(_refuse_strangers)
    app.after_request(_sealed_by(policy))
    app.add_url_rule("/", "page", lambda: text)
    return app


def _refuse_strangers() -> Any:
    """Refuse requests from pages of other hosts, whatever name they use for this machine."""
    host = request.host.rsplit(":", 1)[0] if not request.host.endswith("]") else request.host
    origin, site = request.headers.get("Origin"), request.headers.get("Sec-Fetch-Site", "same-origin")
    if host not in HOSTS or origin not in (None, f"http://{request.host}") or site not in ("same-origin", "none"):
        return jsonify(problem="this server accepts requests only from its own page", fix=None), 403
    return None


def _sealed_by(policy: str) -> Callable[[Response], Response]:
    def sealed(response: Response) -> Response:
        response.headers.update({
            "Content-Security-Policy": policy,
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cache-Control": "no-store",
        })  # fmt: skip
        return response

    return sealed


@contextmanager
def served(app: Flask, port: int = 0) -> Iterator[str]:
    """Serve an application while the block runs; yields its address.

    Args:
        app: application such as :func:`page_app` makes.
        port: port of the loopback interface; 0 takes a free one.

    Raises:
        UserError: the port is taken.
    """
    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # otherwise it prints a line for each request
    server = _server(app, port)
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_port}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def _server(app: Flask, port: int) -> BaseWSGIServer:
    with socket.socket() as probe:  # werkzeug would end the process if the port is taken
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise UserError(
                f"port={port} cannot be used: {error.strerror}", "Leave it out: a free port is used."
            ) from None
    return make_server(HOST, port, app, threaded=True)
