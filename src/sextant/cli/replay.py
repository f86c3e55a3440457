"""``sextant replay``: compute the training step again that was not finite."""

from collections.abc import Sequence

from pydantic import Field

from sextant.console.arguments import Options, UserPath
from sextant.console.console import console, rows_table
from sextant.errors import UserError
from sextant.runs.outputs_folder import default_outputs

USAGE = "sextant replay run=<run directory> [outputs=<folder>] [trust=true]"
#: calls shown before the one that was not finite
SHOWN = 8


class ReplayOptions(Options):
    """The options of ``sextant replay``."""

    run: str = Field(examples=["outputs/runs/classification/1a2b3c4d-s0"])
    """run directory, or its name; a run with debug=nan that was stopped"""
    outputs: UserPath | None = Field(None, examples=["outputs"])
    """folder of runs (default: outputs)"""
    trust: bool = Field(False, examples=["true"])
    """true: build user-defined parts that the run's config names"""


def main(arguments: Sequence[str]) -> None:
    """Replay the step, and show what its modules gave until the value that was not finite.

    Raises:
        UserError: the run has no such step, it names parts from outside Sextant, or all was finite now.
    """
    options = ReplayOptions.parse(arguments, USAGE)
    from sextant.cli.terminal import TERMINAL
    from sextant.lifecycle.debugging import find_run, replay

    outputs = options.outputs or default_outputs()
    found = replay(find_run(options.run, outputs), TERMINAL, outputs=outputs, trust=options.trust)
    rows = [
        {"module": call.path, "kind": call.kind, "shape": "x".join(map(str, call.shape)),
         "least": f"{call.low:.4g}", "largest": f"{call.high:.4g}"}
        for call in found.calls[-SHOWN:]
    ]  # fmt: skip
    console.print(rows_table(f"Last {len(rows)} of {len(found.calls)} calls", rows))
    console.print(f"in training: {found.kept}", markup=False, soft_wrap=True)
    if found.found is None:
        raise UserError(
            "all values were finite in the replay",
            "The step depends on something that is not kept: a GPU, another precision, or random numbers of NumPy.",
        )
    console.print(f"in the replay: the {found.found.where} is not finite", markup=False, soft_wrap=True)
