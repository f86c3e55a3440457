"""``sextant data``: list, render and verify the datasets that are rendered on this machine."""

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field
from rich.markup import escape
from rich.table import Table

from sextant.cli.arguments import Options
from sextant.cli.console import console, key_value_table
from sextant.cli.data_describe import DESCRIBE, Sharded, describe
from sextant.cli.gallery import gallery
from sextant.cli.work_progress import work_progress
from sextant.composing.compose import compose, to_plain
from sextant.composing.rendered_datasets import is_rendered, rendered_datasets
from sextant.config import validate
from sextant.config.building import naming_groups
from sextant.errors import UserError
from sextant.recipes.assemble import build_dataset

if TYPE_CHECKING:
    from sextant.data.rendered import Progress, RenderedStore, RenderPlan, StoreReport

USAGE = f"""sextant data list
sextant data render dataset=<name> [dataset.<key>=<value> ...] [threads=2] [shards=3 [shard=0]]
{DESCRIBE}
sextant data verify <store or its folder> [repair=true]
sextant data gallery [folder=gallery] [samples=16] [sections=streets,office]"""
LINE_S = 5.0
SHOWN_DAMAGES = 50


class RenderOptions(Sharded):
    """What the user chose of rendering, the config of the dataset apart."""

    threads: int = Field(ge=1, le=256, examples=[2])
    """that render"""


class VerifyOptions(Options):
    """What the user chose of a check."""

    repair: bool = Field(False, examples=["true"])
    """true: forget what is damaged, so that rendering makes it anew"""


def main(arguments: Sequence[str]) -> None:
    """Run one of the commands of :data:`USAGE`."""
    verbs = {"list": _list, "render": _render, "describe": describe, "verify": _verify, "gallery": gallery}
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
    from sextant.data.rendered.finding import stores_in

    cache = _cache(arguments)
    stores = stores_in(cache)
    table = Table("store", "rendered", "on disk", "state")
    for path in stores:
        rendered, state = _state(path)
        table.add_row(escape(path.name), rendered, readable(allocated_bytes(path.rglob("*"))), state)
    if stores:
        console.print(table)
    else:
        console.print(f"nothing is rendered in {escape(str(cache))}; sextant data render dataset=<name> does")


def _state(path: Path) -> tuple[str, str]:
    from sextant.data.rendered import load_store
    from sextant.data.rendered.layout import StoreLayout

    if not StoreLayout(path).manifest.is_file():
        return "", "to be laid out anew: render it"
    try:
        store = load_store(path)
    except UserError:
        return "", f"damaged: sextant data verify {escape(path.name)}"
    return f"{store.rendered:,}/{len(store):,}", "complete" if store.complete else "incomplete"


# --------------------------------------------------------------------------------------------------------------- render


def _render(arguments: list[str]) -> None:
    options, overrides = render_options(arguments)
    if not any(override.startswith("dataset=") for override in overrides):
        raise UserError("which dataset? dataset= is missing", f"{rendered_datasets()}\n\n{USAGE}")
    plan, cache = _plan(overrides)
    began, state = time.monotonic(), "nothing"
    try:
        store = _opened(plan, cache, options)
        state = f"{store.rendered:,} of {len(store):,}"
        with work_progress("rendering", "images") as progress:
            made = _fill(store, plan, cache, options, progress)
    except KeyboardInterrupt:
        state = f"{store.rendered:,} of {len(store):,}" if state != "nothing" else state
        console.print(f"interrupted: {state} rendered; the same command resumes")
        raise SystemExit(130) from None
    seconds = time.monotonic() - began
    facts = {str(name).replace("_", " "): _shown(value) for name, value in store.facts.items()}
    rows = {"images": f"{len(store):,}"} | facts | {"path": str(store.directory), "seconds": f"{seconds:,.1f}"}
    rows["images/s"] = f"{made / seconds:,.1f}" if made else "all were rendered before"
    console.print(key_value_table(plan.name, rows))


def _plan(overrides: Sequence[str]) -> "tuple[RenderPlan, Path]":
    """The plan of the dataset that ``overrides`` choose, and the folder of stores."""
    config = validate(to_plain(compose(overrides)))
    target = config.dataset.target
    if not is_rendered(target):
        chosen = next(override for override in overrides if override.startswith("dataset="))
        raise UserError(f"{chosen} is not rendered: there is nothing to do", rendered_datasets())
    with naming_groups(config.plain):
        source: Any = build_dataset(config)
        return source.plan(), Path(config.paths.cache)


def _opened(plan: "RenderPlan", cache: Path, options: RenderOptions) -> "RenderedStore":
    from sextant.data.rendered import open_shard, open_store

    if options.shards is None or options.shard is None:
        return open_store(plan, cache, notify=_notify)
    return open_shard(plan, cache, options.shard, options.shards, notify=_notify)


def _fill(store: "RenderedStore", plan: "RenderPlan", cache: Path, options: RenderOptions, progress: "Progress") -> int:
    from sextant.data.rendered import chunks_of, merge_shards

    if options.shards is None:
        return store.fill(progress, options.threads)
    if options.shard is None:
        return merge_shards(plan, cache, options.shards, progress, threads=options.threads, notify=_notify)[1]
    return store.fill(progress, options.threads, chunks=chunks_of(store, options.shard, options.shards))


def render_options(arguments: Sequence[str]) -> tuple[RenderOptions, list[str]]:
    """What is chosen of rendering, one thread a core unless said otherwise, and the other arguments."""
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
    from sextant.data.rendered.finding import find_store

    names = [argument for argument in arguments if "=" not in argument]
    paths = [argument for argument in arguments if argument.startswith("paths.")]
    rest = [argument for argument in arguments if argument not in (*names, *paths)]
    repair = VerifyOptions.parse(rest, USAGE).repair
    if len(names) != 1:
        raise UserError("which store? Give one", USAGE)
    directory = find_store(names[0], _cache(paths))
    with work_progress("checking", "chunks") as progress:
        report = verify_store(directory, progress)
    _show(report)
    if report.sound:
        return
    if not repair:
        console.print(f"sextant data verify {escape(str(directory))} repair=true forgets what is damaged")
        raise SystemExit(1)
    repair_store(report, notify=_notify)
    dataset = report.manifest.name if report.manifest else "<name>"
    console.print(
        "what is damaged is forgotten, nothing else is lost; it is not rendered again yet:\n"
        f"sextant data render dataset={escape(dataset)} with the keys it was rendered with does"
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


# --------------------------------------------------------------------------------------------------------------- shared


def _cache(overrides: Sequence[str]) -> Path:
    for override in overrides:
        if not override.startswith("paths."):
            raise UserError(f"{override}: not understood", USAGE)
    return Path(to_plain(compose(overrides))["paths"]["cache"])


def _notify(message: str) -> None:
    console.print(escape(message))
