"""The server of the demonstration as a WSGI application, which takes requests of its own page alone."""

import base64
import hashlib
import io
import re
from functools import cache
from pathlib import Path
from typing import Any

from flask import Flask, Request, Response, jsonify, request
from werkzeug.exceptions import HTTPException, RequestEntityTooLarge

from sextant.demo.answers import answer, sample_photo
from sextant.errors import UserError

#: bytes of a photo, and of a request, which has two at most
LARGEST_FILE = 64_000_000
LARGEST_REQUEST = 2 * LARGEST_FILE + 100_000
#: bytes of a setting
LARGEST_TEXT = 500_000
TOO_LARGE = f"the file is too large: {LARGEST_FILE // 10**6} MB are taken", "Save the photo smaller, or as JPEG."
REQUEST_TOO_LARGE = (
    f"the request is too large: {LARGEST_FILE // 10**6} MB are taken for a photo, {LARGEST_TEXT // 1000} kB for a text",
    "Save the photo smaller, or as JPEG; shorten the text.",
)
#: names by which a browser may call this machine; under any other, a page elsewhere has made it believe that this
#: machine is the page's own (DNS rebinding)
HOSTS = ("127.0.0.1", "localhost", "[::1]")


class InMemory(Request):
    """A request whose files are never written to a disk, however large."""

    max_content_length = LARGEST_REQUEST
    max_form_memory_size = LARGEST_TEXT
    max_form_parts = 12

    def _get_file_stream(self, *_: Any, **__: Any) -> io.BytesIO:
        return io.BytesIO()


def demo_app() -> Flask:
    """The application."""
    app = Flask("sextant.demo", static_folder=None)
    app.request_class = InMemory
    app.json.sort_keys = False  # type: ignore[attr-defined]
    app.before_request(_refuse_strangers)
    app.after_request(_sealed)
    app.add_url_rule("/", "page", lambda: page()[0])
    app.add_url_rule("/sample/<name>", "sample", lambda name: Response(sample_photo(name), mimetype="image/jpeg"))

    @app.post("/ask/<question>")
    def ask(question: str) -> Any:
        files = [(each.filename or "", each.read()) for each in request.files.getlist("photo")]
        if any(len(content) > LARGEST_FILE for _, content in files):
            raise UserError(*TOO_LARGE)
        return jsonify(answer(question, files, request.form))

    @app.errorhandler(UserError)
    def mistake(error: UserError) -> Any:
        return jsonify(problem=error.problem, fix=error.fix), 422

    @app.errorhandler(Exception)
    def failure(error: Exception) -> Any:
        if isinstance(error, RequestEntityTooLarge):
            return jsonify(problem=REQUEST_TOO_LARGE[0], fix=REQUEST_TOO_LARGE[1]), 413
        if isinstance(error, HTTPException):
            return jsonify(problem=f"{error.code} {error.name}", fix=None), error.code
        if isinstance(error, MemoryError):
            return jsonify(problem="there is not enough memory for this", fix="Give a smaller photo."), 422
        app.logger.exception("a question could not be answered")
        return jsonify(problem=f"this went wrong: {type(error).__name__}", fix="The terminal has the details."), 500

    return app


@cache
def page() -> tuple[str, str]:
    """The page, and what it may do: run its own script, have its own style, ask its own server."""
    text = Path(__file__).with_name("page.html").read_text("utf-8").replace("LARGEST_FILE", str(LARGEST_FILE))
    script, style = (re.search(rf"<{tag}>(.*?)</{tag}>", text, re.DOTALL) for tag in ("script", "style"))
    assert script is not None
    assert style is not None
    own = [base64.b64encode(hashlib.sha256(each[1].encode()).digest()).decode() for each in (script, style)]
    policy = (
        f"default-src 'none'; script-src 'sha256-{own[0]}'; style-src 'sha256-{own[1]}'; img-src data: blob:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return text, policy


def _refuse_strangers() -> Any:
    """Nothing for another host's page, whatever name it calls this machine by."""
    host = request.host.rsplit(":", 1)[0] if not request.host.endswith("]") else request.host
    origin, site = request.headers.get("Origin"), request.headers.get("Sec-Fetch-Site", "same-origin")
    if host not in HOSTS or origin not in (None, f"http://{request.host}") or site not in ("same-origin", "none"):
        return jsonify(problem="this server answers its own page alone", fix=None), 403
    return None


def _sealed(response: Response) -> Response:
    response.headers.update({
        "Content-Security-Policy": page()[1],
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "DENY",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cache-Control": "no-store",
    })  # fmt: skip
    return response
