"""``sextant register``: register a run as a model in MLflow's registry."""

import shlex
from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from sextant.console.arguments import Options, UserPath
from sextant.console.console import console
from sextant.errors import UserError
from sextant.tracking.environment import quiet_libraries

USAGE = "sextant register run=<run> name=<name>"


class RegisterOptions(Options):
    """What the user chose."""

    run: str
    """an MLflow run id, a run directory or its name, or a checkpoint"""
    name: str
    """name of the model; if it exists, a new version is added"""
    outputs: UserPath | None = None
    """output folder of runs, if not the default"""
    tracking: Literal["sqlite", "server"] = Field("sqlite", examples=["server"])
    """sqlite: the registry of the embedded store (default); server: that of an MLflow server"""
    uri: str | None = Field(None, alias="tracking.uri")
    """address of the server"""


def main(arguments: Sequence[str]) -> None:
    """Register the run, and print how to serve it."""
    quiet_libraries()
    chosen = RegisterOptions.parse(arguments, USAGE)
    if (chosen.tracking == "server") != (chosen.uri is not None):
        raise UserError("tracking=server and tracking.uri= go together", "Give both, or neither (embedded store).")
    from sextant.lifecycle.registering import register_run

    with console.status("registering the run"):
        found = register_run(chosen.run, chosen.name, chosen.outputs, kind=chosen.tracking, uri=chosen.uri)
    console.print(f"{found.name}, version {found.version}, to be served on this machine by", markup=False)
    serve = f"mlflow models serve -m models:/{found.name}/{found.version} --env-manager local --port 5001"
    console.print(f"MLFLOW_TRACKING_URI={shlex.quote(found.registry)} {serve}", markup=False, soft_wrap=True)
