"""``sextant dashboard``: bring MLflow up to date with the run directories, and open it on this machine."""

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from sextant.addresses import file_uri
from sextant.cli.terminal import TERMINAL
from sextant.console.arguments import Options, UserPath
from sextant.console.console import console, print_mistake
from sextant.console.written import make_output
from sextant.errors import UserError
from sextant.runs.outputs_folder import default_outputs
from sextant.tracking.environment import quiet_libraries

if TYPE_CHECKING:
    from sextant.tracking.store import Store

USAGE = "sextant dashboard [port=5000] [serve=true]\nsextant dashboard tracking=server tracking.uri=http://host:5000"
HOST = "127.0.0.1"
#: MLflow's list of experiments for model training; its default page is the one for language models
PAGE = "#/experiments?workflowType=machine_learning"
LOOK_EVERY_S = 30.0


class DashboardOptions(Options):
    """What the user chose."""

    port: int = Field(5000, ge=1024, le=65535, examples=[5000])
    """first port to try on the loopback interface; the next free one is used"""
    serve: bool = Field(True, examples=["false"])
    """false: only update the store from the run directories"""
    outputs: UserPath | None = None
    """output folder, if not the default"""
    tracking: Literal["sqlite", "server"] = Field("sqlite", examples=["server"])
    """server: update a running MLflow server and open none; sqlite: the embedded store (default)"""
    uri: str | None = Field(None, alias="tracking.uri")
    """address of the server"""


def main(arguments: Sequence[str]) -> None:
    """Refill the store and serve it until Ctrl-C."""
    quiet_libraries()
    options = DashboardOptions.parse(arguments, USAGE)
    outputs = default_outputs() if options.outputs is None else options.outputs.absolute()
    make_output(outputs, "outputs")
    server = _server(options)
    from sextant.tracking.server import free_port
    from sextant.tracking.store import open_store, telling_store_errors

    port = free_port(HOST, options.port)

    if server is not None:
        with telling_store_errors(server, outputs):
            _fill(open_store("server", server, outputs), outputs)
        console.print(f"[bold]{server.rstrip('/')}/{PAGE}[/]")
        return
    with telling_store_errors(None, outputs):
        store = open_store("sqlite", None, outputs)
    try:
        _fill(store, outputs)
    except UserError as error:
        if not options.serve:
            raise
        print_mistake(error)  # the existing content can still be viewed
    if options.serve:
        _serve(store, outputs, port)


def _server(options: DashboardOptions) -> str | None:
    """The address of the server to fill; None for the embedded store."""
    uri = options.uri
    if options.tracking == "sqlite":
        if uri is not None:
            raise UserError(f"tracking.uri={uri} belongs to tracking=server", USAGE)
        return None
    if uri is None or not uri.startswith(("http://", "https://")):
        raise UserError(
            f"tracking.uri={uri or ''}: must be the address of the server, starting with http:// or https://",
            "For example tracking=server tracking.uri=http://127.0.0.1:5000",
        )
    if unused := sorted({"port", "serve"} & options.model_fields_set):
        given = f"{unused[0]}={getattr(options, unused[0])}".lower()
        raise UserError(
            f"{given} belongs to tracking=sqlite: a remote server is filled, not served",
            USAGE,
        )
    return uri


def _fill(store: "Store", outputs: Path) -> None:
    from sextant.lifecycle.parent_page import fill_store
    from sextant.tables import counted

    store.tidy()
    changed = fill_store(store, outputs, TERMINAL)
    console.print(f"{counted(changed, 'run')} brought up to date" if changed else "the store is up to date")


def _serve(store: "Store", outputs: Path, port: int) -> None:
    """Serve the embedded store, and check regularly whether runs have died."""
    from sextant.tracking.refill import catch_up
    from sextant.tracking.server import guarded, server_command

    assert store.artifacts is not None
    console.print(f"[bold]http://{HOST}:{port}/{PAGE}[/]  (Ctrl-C ends it)")
    with guarded(server_command(HOST, port, store.uri, file_uri(store.artifacts))) as server:
        while server.poll() is None:
            try:
                server.wait(LOOK_EVERY_S)
            except subprocess.TimeoutExpired:
                catch_up("sqlite", None, outputs, TERMINAL)
