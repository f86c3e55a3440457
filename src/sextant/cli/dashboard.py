"""``sextant dashboard``: bring MLflow up to date with the run directories, and open it on this machine."""

import socket
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sextant.cli.arguments import parse_arguments
from sextant.cli.console import console, print_mistake
from sextant.cli.terminal import TERMINAL
from sextant.errors import UserError
from sextant.runs.outputs_folder import default_outputs
from sextant.tracking.environment import quiet_libraries

if TYPE_CHECKING:
    from sextant.tracking.store import Store

USAGE = "sextant dashboard [port=5000] [serve=true]\nsextant dashboard tracking=server tracking.uri=http://host:5000"
KEYS = {
    "port": "first port to try on the loopback interface; the next free one is taken",
    "serve": "false only fills the store from the run directories",
    "outputs": "output folder, if not the default",
    "tracking": "server: fill a server that runs elsewhere, and open none; sqlite: the embedded store",
    "tracking.uri": "address of that server",
}
HOST = "127.0.0.1"
LOOK_EVERY_S = 30.0


def main(arguments: Sequence[str]) -> None:
    """Refill the store and serve it until Ctrl-C."""
    quiet_libraries()
    given = parse_arguments(arguments, KEYS, USAGE)
    outputs = Path(given["outputs"]).absolute() if "outputs" in given else default_outputs()
    try:
        outputs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"outputs={outputs} is not a folder that can be written to: {error.strerror}") from None
    server = _server(given)
    port = _free_port(given.get("port", "5000"))

    from sextant.tracking.store import open_store, telling_store_errors

    if server is not None:
        with telling_store_errors(server):
            _fill(open_store("server", server, outputs), outputs)
        return
    store = open_store("sqlite", None, outputs)
    try:
        _fill(store, outputs)
    except UserError as error:  # what is there can be looked at
        print_mistake(error)
    if given.get("serve", "true") != "false":
        _serve(store, outputs, port)


def _server(given: Mapping[str, str]) -> str | None:
    """The address of the server to fill, None for the embedded store."""
    kind, uri = given.get("tracking", "sqlite"), given.get("tracking.uri")
    if kind not in ("sqlite", "server"):
        raise UserError(f"tracking={kind}: must be sqlite or server", USAGE)
    if kind == "sqlite":
        if uri is not None:
            raise UserError(f"tracking.uri={uri} belongs to tracking=server", USAGE)
        return None
    if uri is None or not uri.startswith(("http://", "https://")):
        raise UserError(
            f"tracking.uri={uri or ''}: must be the address of the server, starting with http:// or https://",
            "For example tracking=server tracking.uri=http://127.0.0.1:5000",
        )
    unused = [f"{key}={given[key]}" for key in ("port", "serve") if key in given]
    if unused:
        raise UserError(f"{unused[0]} belongs to tracking=sqlite: a remote server is filled, not served", USAGE)
    return uri


def _fill(store: "Store", outputs: Path) -> None:
    from sextant.tracking.refill import refill

    changed = refill(store, outputs, reporter=TERMINAL)
    console.print(f"{changed} runs brought up to date" if changed else "the store is up to date")


def _serve(store: "Store", outputs: Path, port: int) -> None:
    """Serve the embedded store, and look now and then whether runs died."""
    from sextant.tracking.refill import catch_up
    from sextant.tracking.server import guarded, server_command

    assert store.artifacts is not None
    console.print(f"[bold]http://{HOST}:{port}[/]  (Ctrl-C ends it)")
    with guarded(server_command(HOST, port, store.uri, store.artifacts.as_uri())) as server:
        while server.poll() is None:
            try:
                server.wait(LOOK_EVERY_S)
            except subprocess.TimeoutExpired:
                catch_up("sqlite", None, outputs, TERMINAL)


def _free_port(first: str) -> int:
    if not first.isdigit() or not 1024 <= int(first) < 65536:
        raise UserError(f"port={first} must be a number from 1024 to 65535", "For example port=5000")
    for port in range(int(first), min(int(first) + 100, 65536)):
        with socket.socket() as probe:
            if probe.connect_ex((HOST, port)) != 0:
                return port
    raise UserError(f"no free port from {first} on")
