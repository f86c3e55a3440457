"""Rendered datasets: a plan defines what to render, a store keeps it on disk, chunk by chunk."""

from sextant.data.rendered.lock import Showing, notify_every
from sextant.data.rendered.manifest import Manifest, read_manifest
from sextant.data.rendered.plan import ArraySpec, RenderPlan
from sextant.data.rendered.shards import chunks_of, merge_shards, open_shard
from sextant.data.rendered.splits import RenderedSource, modules_sha256
from sextant.data.rendered.store import RenderedStore, load_store, open_store
from sextant.data.rendered.verify import ChunkDamage, FileDamage, StoreReport, forget_chunks, repair_store, verify_store

__all__ = [
    "ArraySpec",
    "ChunkDamage",
    "FileDamage",
    "Manifest",
    "RenderPlan",
    "RenderedSource",
    "RenderedStore",
    "Showing",
    "StoreReport",
    "chunks_of",
    "forget_chunks",
    "load_store",
    "merge_shards",
    "modules_sha256",
    "notify_every",
    "open_shard",
    "open_store",
    "read_manifest",
    "repair_store",
    "verify_store",
]
