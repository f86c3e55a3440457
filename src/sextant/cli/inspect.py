"""``sextant inspect``: what the user's folder or video holds, which tasks fit, and the commands for them."""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field
from rich.markup import escape

from sextant.applications.arguments import check_own_file
from sextant.console.arguments import Options, UserPath
from sextant.console.console import console, print_key_values
from sextant.console.work_progress import work_progress
from sextant.console.written import tell_skipped
from sextant.errors import UserError

if TYPE_CHECKING:
    from sextant.tools.inspection import Inspection

USAGE = "sextant inspect <folder, photo, video or file of poses> [json=inspection.json]"


class InspectOptions(Options):
    """What the user chose."""

    input: UserPath
    """folder, photo, video or file of poses to inspect; input= may be omitted"""
    json_file: UserPath | None = Field(None, alias="json")
    """JSON file for the full results, which list every file"""


def main(arguments: Sequence[str]) -> None:
    """Show what was found, what is unusual about it, and commands to copy."""
    bare = [word for word in arguments if ("=" not in word and not word.startswith("-")) or os.path.lexists(word)]
    words = [f"input={word}" if word in bare[:1] else word for word in arguments]
    options = InspectOptions.parse(words, USAGE)
    if options.json_file is not None:
        check_own_file("json", options.json_file, [options.input], [".json"])
        _keep(options.json_file, options.input)
    from sextant.atomic_files import write_json
    from sextant.tools.inspection import inspect, summary

    found = inspect(options.input, work_progress)
    print_key_values(str(options.input), summary(found.seen))
    tell_skipped(found.seen.unreadable, "Cannot be read")
    for remark in found.remarks:
        console.print(f"[yellow]note:[/] {escape(remark)}", soft_wrap=True)
    _tell_suggestions(found)
    if options.json_file:
        try:
            write_json(options.json_file, found.facts())
        except OSError as error:
            raise UserError(f"json={options.json_file} cannot be written: {error.strerror}") from None
        console.print(escape(str(options.json_file)))


def _keep(file: Path, folder: Path) -> None:
    """Raise a ``UserError`` if the file belongs to the folder, such as a file of poses, unless ``inspect`` wrote it."""
    if not file.is_file() or not file.resolve().is_relative_to(folder.resolve()):
        return
    try:
        ours = "suggestions" in json.loads(file.read_bytes())
    except (ValueError, TypeError):
        ours = False
    if not ours:
        raise UserError(f"json={file} is a file of {folder}: it would be replaced", "For example json=inspection.json")


def _tell_suggestions(found: "Inspection") -> None:
    for each in found.suggestions:
        console.print(f"\n[bold]{escape(each.task)}[/]: {escape(each.why)}", soft_wrap=True)
        for command in each.commands:
            console.print(f"  {escape(command)}", soft_wrap=True)
    if not found.suggestions:
        console.print("no task fits")
