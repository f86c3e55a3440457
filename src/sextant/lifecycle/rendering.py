"""Rendering of the datasets that are made on this machine, as a whole or in shards."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import is_rendered, rendered_datasets
from sextant.config import validate
from sextant.config.building import naming_groups
from sextant.data.rendered import (
    RenderedStore,
    RenderPlan,
    chunks_of,
    load_store,
    merge_shards,
    open_shard,
    open_store,
)
from sextant.data.rendered.layout import StoreLayout
from sextant.errors import UserError, command
from sextant.kit.assemble import build_dataset
from sextant.reporter import Advance


def plan_of(overrides: Sequence[str]) -> tuple[RenderPlan, Path]:
    """The render plan of the dataset that ``overrides`` choose, and the folder of stores.

    Raises:
        UserError: the dataset is not a rendered one, or an override is wrong.
    """
    config = validate(to_plain(compose(overrides)))
    if not is_rendered(config.dataset.target):
        chosen = next(override for override in overrides if override.startswith("dataset="))
        raise UserError(f"{chosen} is not rendered: there is nothing to do", rendered_datasets())
    with naming_groups(config.plain):
        source: Any = build_dataset(config)
        return source.plan(), Path(config.paths.cache)


def open_target(plan: RenderPlan, cache: Path, shards: int | None, shard: int | None) -> RenderedStore:
    """Open the store to fill: that of the whole dataset, or of one shard."""
    if shards is None or shard is None:
        return open_store(plan, cache)
    return open_shard(plan, cache, shard, shards)


def fill(
    store: RenderedStore,
    plan: RenderPlan,
    cache: Path,
    shards: int | None,
    shard: int | None,
    threads: int,
    progress: Advance | None = None,
) -> int:
    """Render what a store of :func:`open_target` lacks; with ``shards`` but no ``shard``, merge the shards.

    Returns:
        The number of items that were rendered or copied.
    """
    if shards is None:
        return store.fill(progress, threads)
    if shard is None:
        return merge_shards(plan, cache, shards, progress, threads=threads)[1]
    return store.fill(progress, threads, chunks=chunks_of(store, shard, shards))


def state_of(directory: Path) -> tuple[str, str]:
    """How much of a store is rendered, and its state."""
    if not StoreLayout(directory).manifest.is_file():
        return "", "has no manifest: render it again"
    try:
        store = load_store(directory)
    except UserError:
        return "", f"damaged: {command('data', 'verify', str(directory))}"
    return f"{store.rendered:,}/{len(store):,}", "complete" if store.complete else "incomplete"
