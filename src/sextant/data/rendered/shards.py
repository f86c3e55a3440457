"""Rendering a store in shards, each by its own process on any host, and merging them.

A shard is a separate store that lacks what belongs to the others, so that no two hosts write to the same file.
"""

from copy import copy
from pathlib import Path

import numpy as np
from numpy import ndarray

from sextant.data.rendered.lock import Notify, log
from sextant.data.rendered.plan import RenderPlan
from sextant.data.rendered.store import RenderedStore, open_store
from sextant.errors import ArgumentError, UserError
from sextant.reporter import Advance


def open_shard(
    plan: RenderPlan, cache: Path | str, shard: int, shards: int, *, notify: Notify = log.info
) -> RenderedStore:
    """Open the store of one shard, in its own folder below ``cache``.

    Args:
        plan: what all shards together render.
        cache: folder of stores.
        shard: its number, from 0.
        shards: number of shards.
        notify: receives a message when this process waits for another.

    Raises:
        ArgumentError: there is no such shard.
        UserError: as :func:`~sextant.data.rendered.store.open_store`.
    """
    if not 0 <= shard < shards:
        raise ArgumentError(f"shard={shard}: there are shards 0 to {shards - 1}", "shards=3 has shard=0, 1 and 2")
    return open_store(plan, Path(cache) / "shards" / f"{shard}_of_{shards}", notify=notify)


def chunks_of(store: RenderedStore, shard: int, shards: int) -> range:
    """Every chunk whose number modulo ``shards`` is ``shard``, which spreads out parts that take long."""
    return range(shard, store.manifest.grid.chunks, shards)


def merge_shards(
    plan: RenderPlan,
    cache: Path | str,
    shards: int,
    progress: Advance | None = None,
    *,
    threads: int = 1,
    notify: Notify = log.info,
) -> tuple[RenderedStore, int]:
    """Copy the shards' chunks into the store of the plan, comparing each with its hash.

    Returns:
        The store, and the number of items copied.

    Raises:
        UserError: a shard lacks chunks; the message names it. Nothing was copied, and only that shard needs rendering.
        DamagedStoreError: a chunk of a shard differs from its hash; the message names it.
    """
    store = open_store(plan, cache, notify=notify)
    parts = [open_shard(plan, cache, shard, shards, notify=notify) for shard in range(shards)]
    lacking = {shard: n for shard, part in enumerate(parts) if (n := _missing(store, part, shard, shards))}
    if lacking:
        counts = {shard: len(chunks_of(store, shard, shards)) for shard in lacking}
        told = ", ".join(f"shard {shard} lacks {n} of {counts[shard]} chunks" for shard, n in lacking.items())
        raise UserError(f"{plan.name}: {told}", f"Render what is missing: shards={shards} shard={next(iter(lacking))}")

    def from_shard(start: int, stop: int) -> dict[str, ndarray]:
        part = parts[start // store.manifest.chunk % shards]
        return {name: part.read(name, np.arange(start, stop)) for name in store.manifest.arrays}

    copying = copy(plan)
    copying.render = from_shard  # type: ignore[method-assign]
    return store, RenderedStore(store.directory, copying, notify).fill(progress, threads)


def _missing(store: RenderedStore, part: RenderedStore, shard: int, shards: int) -> int:
    """Number of a shard's chunks that are neither in it nor in the whole store."""
    chunks = np.array(chunks_of(store, shard, shards), dtype=np.int64)
    return int((~(store.on_disk() | part.on_disk()))[chunks].sum())
