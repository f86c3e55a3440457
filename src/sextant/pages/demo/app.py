"""The server of the demonstration as a WSGI application, which accepts requests of its own page only."""

import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

from flask import Flask, Request, Response, jsonify, request
from werkzeug.exceptions import HTTPException, RequestEntityTooLarge

from sextant.errors import UserError
from sextant.pages.demo.answers import MAPS, answer, maps, prepare, sample_photo
from sextant.pages.loopback import page_app
from sextant.pages.loopback import served as served_page
from sextant.tools.demonstration.where_taken import WhereTaken

PAGE = Path(__file__).with_name("page.html")
#: largest size of a photo, and of a request with at most two photos, in bytes
LARGEST_FILE = 64_000_000
LARGEST_REQUEST = 2 * LARGEST_FILE + 100_000
#: largest size of a setting, in bytes
LARGEST_TEXT = 500_000
TOO_LARGE = f"the file is too large: at most {LARGEST_FILE // 10**6} MB", "Save a smaller version, or as JPEG."
REQUEST_TOO_LARGE = (
    f"the request is too large: at most {LARGEST_FILE // 10**6} MB for a photo, {LARGEST_TEXT // 1000} kB for a text",
    "Save a smaller version, or as JPEG; shorten the text.",
)


class InMemory(Request):
    """A request whose files are never written to a disk, however large."""

    max_content_length = LARGEST_REQUEST
    max_form_memory_size = LARGEST_TEXT
    max_form_parts = 12

    def _get_file_stream(self, *_: Any, **__: Any) -> io.BytesIO:
        return io.BytesIO()


def demo_app() -> Flask:
    """The application."""
    shown = json.dumps(maps()).replace("<", "\\u003c")  # a name cannot end the script
    app = page_app("sextant.pages.demo", PAGE, {"LARGEST_FILE": str(LARGEST_FILE), "THE_MAPS": shown})
    app.request_class = InMemory
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
            return jsonify(problem="there is not enough memory for this", fix="Use a smaller photo."), 422
        app.logger.exception("a question could not be answered")
        return jsonify(problem=f"unexpected error: {type(error).__name__}", fix="The terminal has the details."), 500

    return app


@contextmanager
def served(port: int = 0, given: WhereTaken | None = None) -> Iterator[str]:
    """Serve the demonstration while the block runs; yields its address.

    Args:
        port: port of the loopback interface; 0 takes a free one.
        given: the user's map of posed photos, beside the rendered one.

    Raises:
        UserError: the port is taken.
    """
    if given is not None:
        MAPS["given"] = lambda: given
    with served_page(demo_app(), port) as address:
        Thread(target=prepare, daemon=True).start()
        try:
            yield address
        finally:
            MAPS.pop("given", None)
