"""The demonstration on a port of this machine that nothing else can reach."""

import logging
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread

from werkzeug.serving import BaseWSGIServer, make_server

from sextant.demo.answers import prepare
from sextant.demo.app import demo_app
from sextant.errors import UserError

HOST = "127.0.0.1"


@contextmanager
def served(port: int = 0) -> Iterator[str]:
    """The address of the demonstration, which is served while the block runs.

    Args:
        port: of the loopback interface; 0 takes one that is free.

    Raises:
        UserError: the port is taken.
    """
    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # a line for each request otherwise
    server = _server(port)
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    Thread(target=prepare, daemon=True).start()
    try:
        yield f"http://{HOST}:{server.server_port}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def _server(port: int) -> BaseWSGIServer:
    with socket.socket() as probe:  # werkzeug would end the process
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise UserError(
                f"port={port} cannot be used: {error.strerror}", "Leave it out: a free one is taken."
            ) from None
    return make_server(HOST, port, demo_app(), threaded=True)
