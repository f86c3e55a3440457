"""``sextant data``: list, render and verify the datasets that are rendered on this machine."""

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field
from rich.markup import escape
from rich.table import Table

from sextant.applications.arguments import check_apart
from sextant.cli.data_describe import DESCRIBE, Sharded, describe
from sextant.cli.gallery import gallery
from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import rendered_datasets
from sextant.config import validate
from sextant.console.arguments import Options, UserPath
from sextant.console.console import console, print_key_values
from sextant.console.work_progress import work_progress
from sextant.console.written import make_output
from sextant.errors import UserError, command

if TYPE_CHECKING:
    from sextant.data.rendered import StoreReport

POSED = "sextant data posed [folder=posed_office]"
USAGE = f"""sextant data list
sextant data render dataset=<name> [dataset.<key>=<value> ...] [threads=2] [shards=3 [shard=0]]
{DESCRIBE}
sextant data verify <store or its folder> [repair=true]
sextant data gallery [folder=gallery] [samples=16] [sections=streets,office]
{POSED}"""
SHOWN_DAMAGES = 50


class RenderOptions(Sharded):
    """What the user chose for rendering, apart from the config of the dataset."""

    threads: int = Field(ge=1, le=256, examples=[2])
    """number of rendering threads"""


class VerifyOptions(Options):
    """What the user chose for a verification."""

    repair: bool = Field(False, examples=["true"])
    """true: discard damaged parts, so that they can be rendered again"""


class PosedOptions(Options):
    """What the user chose for the rendered office."""

    folder: UserPath = Path("posed_office")
    """folder for map/ with poses.csv, photos/ to locate and truth.csv (default: posed_office)"""


def main(arguments: Sequence[str]) -> None:
    """Run one of the commands of :data:`USAGE`."""
    verbs = {
        "list": _list,
        "render": _render,
        "describe": describe,
        "verify": _verify,
        "gallery": gallery,
        "posed": _posed,
    }
    verb = arguments[0] if arguments else "list"
    if any(argument in ("-h", "--help") for argument in arguments):
        print(USAGE)
    elif verb in verbs:
        verbs[verb](list(arguments[1:]))
    else:
        raise UserError(f"data {' '.join(arguments)}: not understood", USAGE)


# ----------------------------------------------------------------------------------------------------------------- list


def _list(arguments: list[str]) -> None:
    from sextant.data.rendered.disk import allocated_bytes, readable
    from sextant.data.rendered.verify import stores_in
    from sextant.lifecycle.rendering import state_of

    cache = _cache(arguments)
    stores = stores_in(cache)
    table = Table("store", "rendered", "on disk", "state")
    for path in stores:
        rendered, state = state_of(path)
        table.add_row(escape(path.name), rendered, readable(allocated_bytes(path.rglob("*"))), escape(state))
    if stores:
        console.print(table)
    else:
        render = command("data", "render", "dataset=<name>")
        console.print(f"nothing is rendered in {cache}; to render a dataset: {render}", markup=False, soft_wrap=True)


# --------------------------------------------------------------------------------------------------------------- render


def _render(arguments: list[str]) -> None:
    options, overrides = render_options(arguments)
    if not any(override.startswith("dataset=") for override in overrides):
        raise UserError("dataset= is missing", f"{rendered_datasets()}\n\n{USAGE}")
    from sextant.lifecycle.rendering import fill, open_target, plan_of

    plan, cache = plan_of(overrides)
    began = time.monotonic()
    store = open_target(plan, cache, options.shards, options.shard)
    with work_progress("rendering", "images") as progress:
        made = fill(store, plan, cache, options.shards, options.shard, options.threads, progress)
    seconds = time.monotonic() - began
    facts = {str(name).replace("_", " "): _shown(value) for name, value in store.facts.items()}
    rows = {"images": f"{len(store):,}"} | facts | {"path": str(store.directory), "seconds": f"{seconds:,.1f}"}
    rows["images/s"] = f"{made / seconds:,.1f}" if made else "all were already rendered"
    print_key_values(plan.name, rows)


def render_options(arguments: Sequence[str]) -> tuple[RenderOptions, list[str]]:
    """Split arguments into rendering options, by default one thread per core, and the others."""
    given = {"threads": str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2)}
    overrides = []
    for argument in arguments:
        key, _, value = argument.partition("=")
        if key in RenderOptions.fields():
            given[key] = value
        else:
            overrides.append(argument)
    return RenderOptions.of(given, USAGE), overrides


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_shown(inner)}" for name, inner in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(_shown, value))
    if isinstance(value, float):
        return f"{value:,.6g}"
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)


# --------------------------------------------------------------------------------------------------------------- verify


def _verify(arguments: list[str]) -> None:
    from sextant.data.rendered import repair_store, verify_store
    from sextant.data.rendered.verify import find_store

    names = [argument for argument in arguments if "=" not in argument]
    paths = [argument for argument in arguments if argument.startswith("paths.")]
    rest = [argument for argument in arguments if argument not in (*names, *paths)]
    repair = VerifyOptions.parse(rest, USAGE).repair
    if len(names) != 1:
        raise UserError("name one store", USAGE)
    directory = find_store(names[0], _cache(paths))
    with work_progress("checking", "chunks") as progress:
        report = verify_store(directory, progress)
    _show(report)
    if report.sound:
        return
    if not repair:
        told = command("data", "verify", str(directory), "repair=true")
        console.print(f"{told} discards the damaged parts", markup=False, soft_wrap=True)
        raise SystemExit(1)
    repair_store(report)
    render = command("data", "render", f"dataset={report.manifest.name if report.manifest else '<name>'}")
    console.print(
        "damaged parts are discarded, everything else is kept. To render them again, repeat with the original keys:\n"
        f"{render}",
        markup=False,
        soft_wrap=True,
    )


def _show(report: "StoreReport") -> None:
    for file in report.damaged_files:
        console.print(f"[red]damaged[/] {escape(str(file.path))}: {escape(file.what)}")
    for chunk in report.damaged_chunks[:SHOWN_DAMAGES]:
        console.print(f"[red]damaged[/] {chunk.array} chunk {chunk.chunk}: items {chunk.start} to {chunk.stop - 1}")
    if (more := len(report.damaged_chunks) - SHOWN_DAMAGES) > 0:
        console.print(f"[red]damaged[/] and {more} more chunks")
    if report.manifest is None:
        return
    state = "sound" if report.sound else "[red]damaged[/]"
    count = report.manifest.count
    rendered = f"{count - report.missing_items:,} of {count:,} items rendered"
    console.print(f"{escape(report.directory.name)}: {state}, {len(report.rendered_chunks):,} chunks, {rendered}")


# ---------------------------------------------------------------------------------------------------------------- posed


def _posed(arguments: list[str]) -> None:
    """Render the office, and print the command that locates its photos."""
    options = PosedOptions.parse(arguments, POSED)
    from sextant.tools.demonstration.posed_office import camera, render_posed_office

    make_output(options.folder, "folder")
    with work_progress("rendering", "images") as progress:
        render_posed_office(options.folder, progress)
    fx, fy, cx, cy = camera()
    words = (
        f"map={options.folder / 'map'}",
        f"input={options.folder / 'photos'}",
        f"camera={fx:.2f},{fy:.2f},{cx},{cy}",
    )
    console.print(f"to locate the photos: {command('locate', *words)}", markup=False, soft_wrap=True)


# --------------------------------------------------------------------------------------------------------------- shared


def _cache(overrides: Sequence[str]) -> Path:
    """The folder of stores; a ``UserError`` if it is a file."""
    for override in overrides:
        if not override.startswith("paths."):
            raise UserError(f"{override}: not understood", USAGE)
    cache = Path(validate(to_plain(compose(overrides))).paths.cache)
    check_apart(cache, key="paths.cache")
    return cache
