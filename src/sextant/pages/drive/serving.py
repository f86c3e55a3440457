"""Serving the page of a drive on a port of this machine, while the drive is localized."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from flask import Flask, jsonify, request

from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.written_poses import Moment
from sextant.pages.drive.watch import Watch
from sextant.pages.loopback import page_app, served

PAGE = Path(__file__).with_name("page.html")


def drive_app(watch: Watch) -> Flask:
    """The application: the page, and ``/after?step=3``, which waits for a later step."""
    app = page_app("sextant.pages.drive", PAGE)

    @app.get("/after")
    def after() -> Any:
        return jsonify(watch.after(request.args.get("step", -1, int)))

    return app


@contextmanager
def watched(localizer: Localizer, port: int, tell: Callable[[str], None]) -> Iterator[Callable[[Moment], None]]:
    """A function to call with each step of a drive, which the page shows while the block runs.

    Args:
        localizer: localizer of the drive.
        port: port of the loopback interface; 0 takes a free one.
        tell: called with the page's address once it is served.

    Raises:
        UserError: the port is taken.
    """
    watch = Watch(localizer.model.map.poses[:, :2].numpy(), localizer.unit)
    with served(drive_app(watch), port) as address:
        tell(address)
        try:
            yield watch.show
        finally:
            watch.end()
