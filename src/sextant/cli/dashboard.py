"""``sextant dashboard``: MLflow on this machine, after its store was brought up to date with the run directories."""

import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from sextant.cli.arguments import parse_arguments
from sextant.cli.console import console
from sextant.errors import UserError
from sextant.runs.outputs_folder import default_outputs
from sextant.tracking.environment import quiet_libraries

USAGE = "sextant dashboard [port=5000] [serve=true]"
KEYS = {
    "port": "first port to try on the loopback interface; the next free one is taken",
    "serve": "false only fills the store from the run directories",
    "outputs": "output folder, if not the default",
}
HOST = "127.0.0.1"


def main(arguments: Sequence[str]) -> None:
    """Refill the store and serve it until Ctrl-C."""
    quiet_libraries()
    given = parse_arguments(arguments, KEYS, USAGE)
    outputs = Path(given["outputs"]).absolute() if "outputs" in given else default_outputs()
    try:
        outputs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"outputs={outputs} is not a folder that can be written to: {error.strerror}") from None
    port = _free_port(given.get("port", "5000"))

    from sextant.tracking.mirror import refill
    from sextant.tracking.store import open_store, sqlite_uri
    from sextant.tracking.sweep_parent import refill_parents

    store = open_store("sqlite", None, outputs)
    changed = refill(store, outputs, progress=lambda name: console.print(f"filling {name}"))
    changed += refill_parents(store, outputs)
    console.print(f"{changed} runs brought up to date" if changed else "the store is up to date")
    if given.get("serve", "true") == "false":
        return
    console.print(f"[bold]http://{HOST}:{port}[/]  (Ctrl-C ends it)")
    command = [sys.executable, "-m", "mlflow", "server", "--host", HOST, "--port", str(port), "--workers", "1"]
    command += ["--backend-store-uri", sqlite_uri(outputs), "--artifacts-destination", (outputs / "artifacts").as_uri()]
    subprocess.run(command, check=False, env=os.environ)


def _free_port(first: str) -> int:
    if not first.isdigit() or not 1024 <= int(first) < 65536:
        raise UserError(f"port={first} must be a number from 1024 to 65535", "For example port=5000")
    for port in range(int(first), min(int(first) + 100, 65536)):
        with socket.socket() as probe:
            if probe.connect_ex((HOST, port)) != 0:
                return port
    raise UserError(f"no free port from {first} on")
