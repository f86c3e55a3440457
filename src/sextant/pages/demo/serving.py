"""Serving the demonstration on a port of this machine; what it needs loads while the user still looks for a photo."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread

from sextant.pages.demo.answers import prepare
from sextant.pages.demo.app import demo_app
from sextant.pages.loopback import served as served_page


@contextmanager
def served(port: int = 0) -> Iterator[str]:
    """Serve the demonstration while the block runs; yields its address.

    Args:
        port: port of the loopback interface; 0 takes a free one.

    Raises:
        UserError: the port is taken.
    """
    with served_page(demo_app(), port) as address:
        Thread(target=prepare, daemon=True).start()
        yield address
