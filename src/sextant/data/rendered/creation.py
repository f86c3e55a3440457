"""Laying out a store on disk, before anything is rendered."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy import ndarray

from sextant.atomic_files import write_atomically
from sextant.data.rendered.disk import reporting_disk_errors
from sextant.data.rendered.journal import Journal
from sextant.data.rendered.layout import StoreLayout, make_arrays
from sextant.data.rendered.lock import Notify, store_lock
from sextant.data.rendered.manifest import Manifest, manifest_of, write_manifest
from sextant.data.rendered.plan import RenderPlan, check_plan


def create_store(directory: Path, plan: RenderPlan, notify: Notify) -> None:
    """Write columns, empty arrays and finally the manifest, unless another process does.

    Chunks rendered before the manifest was lost are kept.

    Raises:
        UserError: the folder cannot be written to, or the disk is full.
    """
    layout = StoreLayout(directory)
    with store_lock(directory, layout.manifest.is_file, notify) as held:
        if held and not layout.manifest.is_file():
            check_plan(plan)
            columns, manifest = dict(plan.columns), manifest_of(plan)
            with reporting_disk_errors(directory, lambda: manifest.count * manifest.item_bytes):
                _lay_out(layout, manifest, columns)


def _lay_out(layout: StoreLayout, manifest: Manifest, columns: Mapping[str, ndarray]) -> None:
    (layout.path / "columns").mkdir(parents=True, exist_ok=True)
    for leftover in layout.path.rglob(".*.tmp"):  # left by a process killed while writing
        leftover.unlink(missing_ok=True)
    hashes = _write_columns(layout, columns)
    kept = make_arrays(layout, manifest.arrays, manifest.count)
    journal = Journal(layout.journal, manifest.grid)
    journal.keep({chunk: record for chunk, record in journal.records().items() if record.stop <= kept})
    write_manifest(layout.manifest, replace(manifest, columns=hashes))


def _write_columns(layout: StoreLayout, columns: Mapping[str, ndarray]) -> dict[str, str]:
    hashes = {}
    for name, values in columns.items():
        buffer = BytesIO()
        np.save(buffer, np.ascontiguousarray(values), allow_pickle=False)
        content = buffer.getvalue()
        write_atomically(layout.column(name), lambda file, content=content: file.write(content))  # type: ignore[misc]
        hashes[name] = hashlib.sha256(content).hexdigest()
    return hashes
