"""The map that a run or a folder refers to; imports nothing heavy."""

from pathlib import Path

from sextant.atomic_files import read_json
from sextant.errors import UserError, command
from sextant.runs.resolve import resolve_run
from sextant.zoo import PREFIX

#: in a run's folder
MAP = "map"
HEADER, FORMAT = "map.json", "sextant.localization_map"


def find_map(reference: Path | str, outputs: Path) -> Path | None:
    """The folder of the map of a localization run or a model of the zoo; None if there is no such run.

    Args:
        reference: a folder that a map was saved to, or a run, as for :func:`~sextant.runs.resolve.resolve_run`.
        outputs: folder of runs.

    Raises:
        UserError: the run saved no map.
    """
    path = Path(reference).expanduser()
    for folder in (path, path / MAP):
        header = read_json(folder / HEADER)
        if isinstance(header, dict) and header.get("format") == FORMAT:
            return folder
    try:
        found = resolve_run(str(reference), outputs)
    except UserError:
        return None  # reported where a run is needed
    if str(reference).startswith(PREFIX):  # a model of the zoo keeps the map beside its weights, in a folder of its own
        folder = found.checkpoint.with_suffix("")
        return folder if (folder / HEADER).is_file() else None
    if found.directory is None or found.directory.state().get("task") != "localization":
        return None
    folder = found.directory.path / MAP
    if folder.is_dir():
        return folder
    raise UserError(
        f"run={reference}: the run saved no map in {folder}",
        f"{command('evaluate', f'run={reference}', 'task.save_map=true')} writes one; then run=<the folder of that "
        "test>. Runs with a laser have no map of images.",
    )
