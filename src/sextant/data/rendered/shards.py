"""Rendering a store in parts, each by a process of its own on any host, and putting them together.

A shard is a store of its own that lacks what belongs to the others, so that no two hosts write to one file.
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
    """The store of one shard, in a folder of its own below ``cache``.

    Args:
        plan: what to render, of all shards together.
        cache: folder of stores.
        shard: its number, from 0.
        shards: how many there are.
        notify: gets a message when this process waits for another.

    Raises:
        ArgumentError: there is no such shard.
        UserError: as :func:`~sextant.data.rendered.store.open_store`.
    """
    if not 0 <= shard < shards:
        raise ArgumentError(f"shard={shard}: there are shards 0 to {shards - 1}", "shards=3 has shard=0, 1 and 2")
    return open_store(plan, Path(cache) / "shards" / f"{shard}_of_{shards}", notify=notify)


def chunks_of(store: RenderedStore, shard: int, shards: int) -> range:
    """Every chunk whose number leaves ``shard`` when divided by ``shards``: places that take long are shared out."""
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
    """Copy what the shards have into the store of the plan; each chunk is compared with its hash on the way.

    Returns:
        The store, and how many items were copied.

    Raises:
        UserError: a shard lacks chunks, and names it; nothing was copied, and all that is needed is to render that one.
        DamagedStoreError: a chunk of a shard is not what was rendered; names it.
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
    """How many chunks of a shard are neither there nor in the whole store."""
    chunks = np.array(chunks_of(store, shard, shards), dtype=np.int64)
    return int((~(store.on_disk() | part.on_disk()))[chunks].sum())
