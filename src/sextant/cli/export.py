"""``sextant export``: export the network of a run for other programs."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from sextant.console.arguments import Options, UserPath
from sextant.console.console import console
from sextant.console.written import make_output

USAGE = "sextant export run=<run> [format=onnx|torch_export] [output=<folder>]"


class ExportOptions(Options):
    """What the user chose."""

    run: str
    """an MLflow run id, a run directory or its name, or a checkpoint"""
    format: Literal["onnx", "torch_export"] = "onnx"
    """onnx (default), or torch_export to be read by torch.export.load"""
    output: UserPath | None = None
    """folder for the file and its model card (default: exported/<task>/<run> in the output folder)"""
    outputs: UserPath | None = None
    """output folder of runs, if not the default"""
    trust: bool = Field(False, examples=["true"])
    """true: build user-defined parts that the checkpoint names"""


def main(arguments: Sequence[str]) -> None:
    """Export the network, compare it with the original, and print where it is."""
    chosen = ExportOptions.parse(arguments, USAGE)
    if chosen.output is not None:
        make_output(chosen.output)
    from sextant.lifecycle.exporting import export_run

    with console.status("tracing the network"):
        found = export_run(chosen.run, chosen.format, chosen.output, chosen.outputs, trust=chosen.trust)
    console.print(f"{found.network}\n{found.card}", markup=False)
    console.print(f"its outputs equal the original's to within {found.parity:.1g} of the largest output")
