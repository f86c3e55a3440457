"""Exporting the network of a trained run."""

from dataclasses import dataclass
from pathlib import Path

from sextant.applications.arguments import check_apart
from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_atomically
from sextant.errors import command
from sextant.kit.trained import read_trained
from sextant.lifecycle.export_formats import FILES, Format, write_network
from sextant.lifecycle.offered import exportable
from sextant.reports.model_card import model_card
from sextant.runs.checkpoint import KEY
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run
from sextant.zoo.files import card_of

CARD = "model_card.md"


@dataclass(frozen=True)
class ExportedRun:
    """What was written.

    Attributes:
        network: the file of the network.
        card: the model card beside it.
        parity: largest difference from the network's own outputs, relative to the largest of them or to 1.
    """

    network: Path
    card: Path
    parity: float


def export_run(
    run: str,
    form: Format = "onnx",
    output: Path | None = None,
    outputs: Path | None = None,
    *,
    trust: bool = False,
) -> ExportedRun:
    """Export the network of a run for programs without Sextant, and compare its outputs with the original.

    Push-pull layers become plain convolutions. The batch may have any size; height and width are those of training.

    Args:
        run: an MLflow run id, a run directory or its name, or a checkpoint.
        form: ``onnx``, or ``torch_export`` for ``torch.export.load``.
        output: folder for the file; by default ``exported/<task>/<run>`` in the folder of outputs.
        outputs: folder of runs; by default where runs are written.
        trust: allow parts from outside Sextant that the checkpoint names.

    Raises:
        UserError: the run does not exist, it has no network of its own, or the file's outputs differ.

    Example:
        >>> exported = export_run("1a2b3c4d-s0")  # doctest: +SKIP
        >>> exported.network, exported.parity  # doctest: +SKIP
    """
    outputs = outputs or default_outputs()
    found = resolve_run(run, outputs)
    content = read_trained(found.checkpoint)
    network = exportable(content, found.checkpoint, trust=trust)
    task, name = content[KEY]["task"], (found.directory.path if found.directory else found.checkpoint).name
    folder = output or outputs / "exported" / task / name
    check_apart(folder, run=found.directory.path if found.directory else found.checkpoint)
    parity = write_network(network, form, folder / FILES[form])
    exported_by = command("export", f"run={run}", f"format={form}")
    note = (
        f"`{FILES[form]}` is the network of `{task}/{name}`, written by `{exported_by}`. "
        f"On noise its outputs equal the original's to within {parity:.1g} of the largest output."
    )
    card = card_of(found.checkpoint)
    text = model_card(
        f"{task}: {name}", list(network.meanings.items()), content[KEY], found.directory, outputs, [note], card
    )
    with telling_write_errors(folder):
        write_atomically(folder / CARD, lambda file: file.write(text.encode()))
    return ExportedRun(folder / FILES[form], folder / CARD, parity)
