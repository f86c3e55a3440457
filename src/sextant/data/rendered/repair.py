"""Forgetting damaged parts of a store, so that these and nothing else are rendered again."""

from collections.abc import Iterable
from pathlib import Path

from sextant.data.rendered.disk import reporting_disk_errors
from sextant.data.rendered.journal import Journal
from sextant.data.rendered.layout import DamagedStoreError, StoreLayout, array_offset
from sextant.data.rendered.lock import Notify, log, store_lock
from sextant.data.rendered.manifest import read_manifest
from sextant.data.rendered.verify import StoreReport


def forget_chunks(directory: Path | str, chunks: Iterable[int], *, notify: Notify = log.info) -> None:
    """Drop chunks from a store's journal, so that the next fill renders them again; waits for a rendering process.

    Raises:
        UserError: the store cannot be written to.
        DamagedStoreError: its manifest cannot be read.
    """
    layout = StoreLayout(Path(directory).absolute())
    dropped = set(chunks)
    with store_lock(layout.path, lambda: False, notify), reporting_disk_errors(layout.path, lambda: 0):
        journal = Journal(layout.journal, read_manifest(layout.path).grid)
        journal.keep({chunk: record for chunk, record in journal.records().items() if chunk not in dropped})


def repair_store(report: StoreReport, *, notify: Notify = log.info) -> None:
    """Forget the damaged chunks of a verified store, and remove damaged files.

    If a file is damaged as a whole, the manifest is removed too: opening the store with its plan then recreates what is
    missing and keeps every sound chunk.

    Raises:
        UserError: the store cannot be written to.
    """
    layout, manifest = StoreLayout(report.directory), report.manifest
    if manifest is not None and report.damaged_chunks:
        forget_chunks(layout.path, {damage.chunk for damage in report.damaged_chunks}, notify=notify)
    if not report.damaged_files:
        return
    with store_lock(layout.path, lambda: False, notify), reporting_disk_errors(layout.path, lambda: 0):
        layout.journal.touch()  # marks the folder as a store while its manifest is gone
        for name, spec in manifest.arrays.items() if manifest is not None else ():
            try:
                array_offset(layout.array(name), spec, manifest.count if manifest is not None else 0)
            except DamagedStoreError:
                layout.array(name).unlink(missing_ok=True)
        layout.manifest.unlink(missing_ok=True)
