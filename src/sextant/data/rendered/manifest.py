"""The manifest of a store: what it holds, readable without its renderer."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sextant.atomic_files import write_atomically
from sextant.data.rendered.journal import Grid
from sextant.data.rendered.layout import DamagedStoreError, StoreLayout
from sextant.data.rendered.plan import ArraySpec, RenderPlan, canonical_sha256, plan_digest

FORMAT = 1


@dataclass(frozen=True)
class Manifest:
    """What a store holds.

    Attributes:
        name: the dataset's name.
        digest: hash of config and source; its first eight digits are in the name of the store's folder.
        source_sha256: version of the renderer.
        config: everything that determines what is rendered.
        facts: facts about the dataset for the user.
        count: number of items.
        chunk: number of items in a chunk.
        arrays: rendered arrays by name.
        columns: SHA-256 of each column's file by name.
    """

    name: str
    digest: str
    source_sha256: str
    config: Mapping[str, Any]
    facts: Mapping[str, Any]
    count: int
    chunk: int
    arrays: Mapping[str, ArraySpec]
    columns: Mapping[str, str]

    @property
    def grid(self) -> Grid:
        """How the items are divided into chunks."""
        return Grid(self.count, self.chunk)

    @property
    def item_bytes(self) -> int:
        """Bytes of one item, over all arrays."""
        return sum(spec.item_bytes for spec in self.arrays.values())


def manifest_of(plan: RenderPlan) -> Manifest:
    """The manifest of a plan, before its columns are written; may build the plan's world."""
    return Manifest(
        name=plan.name,
        digest=plan.digest,
        source_sha256=plan.source_sha256,
        config=dict(plan.config),
        facts=dict(plan.facts),
        count=plan.count,
        chunk=plan.chunk,
        arrays=dict(plan.arrays),
        columns={},
    )


def write_manifest(path: Path, manifest: Manifest) -> None:
    """Write a manifest atomically, sealed with its own hash.

    Raises:
        OSError: the disk refused.
    """
    arrays = {name: {"shape": list(s.shape), "dtype": np.dtype(s.dtype).str} for name, s in manifest.arrays.items()}
    content = {"format": FORMAT} | asdict(manifest) | {"arrays": arrays}
    text = json.dumps(content | {"seal": canonical_sha256(content)}, indent=2, allow_nan=False) + "\n"
    write_atomically(path, lambda file: file.write(text.encode()))


def read_manifest(directory: Path) -> Manifest:
    """Read the manifest of the store in ``directory``.

    Raises:
        DamagedStoreError: it is missing, unreadable or altered.
    """
    path = StoreLayout(directory).manifest
    try:
        content = json.loads(path.read_bytes())
        seal = content.pop("seal")
        written = content.pop("format")
        arrays = {name: ArraySpec(tuple(a["shape"]), np.dtype(a["dtype"])) for name, a in content["arrays"].items()}
        manifest = Manifest(**(content | {"arrays": arrays}))
    except FileNotFoundError:
        raise DamagedStoreError.at(path, "the manifest is missing") from None
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise DamagedStoreError.at(path, f"the manifest cannot be read: {error}") from None
    if written != FORMAT or seal != canonical_sha256({"format": written} | content):
        raise DamagedStoreError.at(path, "the manifest was altered: it does not match its own hash")
    if plan_digest(manifest.config, manifest.source_sha256) != manifest.digest:
        raise DamagedStoreError.at(path, f"the manifest's digest {manifest.digest[:8]} does not match its config")
    return manifest
