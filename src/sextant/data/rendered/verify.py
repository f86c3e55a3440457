"""Checking every byte of a store against its journal and its manifest, and mending and finding stores."""

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from sextant.data.rendered.disk import reporting_disk_errors
from sextant.data.rendered.journal import ChunkRecord, Journal
from sextant.data.rendered.layout import DamagedStoreError, StoreLayout, array_offset, check_array, part_sha256
from sextant.data.rendered.lock import Notify, log, store_lock
from sextant.data.rendered.manifest import Manifest, read_manifest
from sextant.errors import UserError
from sextant.reporter import Advance


@dataclass(frozen=True)
class ChunkDamage:
    """A damaged chunk of one array: the items from ``start`` up to ``stop`` are not what was rendered."""

    array: str
    chunk: int
    start: int
    stop: int


@dataclass(frozen=True)
class FileDamage:
    """A file that is missing, short, altered or cannot be read."""

    path: Path
    what: str


@dataclass(frozen=True)
class StoreReport:
    """The state of a store.

    Attributes:
        directory: of the store.
        manifest: what it holds; None if that cannot be read, in which case nothing else was checked.
        damaged_files: files damaged as a whole.
        damaged_chunks: rendered chunks whose bytes changed.
        rendered_chunks: chunks listed in the journal, including damaged ones.
        missing_chunks: chunks that were never rendered, which is not damage.
    """

    directory: Path
    manifest: Manifest | None
    damaged_files: tuple[FileDamage, ...] = ()
    damaged_chunks: tuple[ChunkDamage, ...] = ()
    rendered_chunks: tuple[int, ...] = ()
    missing_chunks: tuple[int, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether nothing is damaged."""
        return not self.damaged_files and not self.damaged_chunks

    @property
    def missing_items(self) -> int:
        """Number of items not rendered."""
        if self.manifest is None:
            return 0
        spans = (self.manifest.grid.span(chunk) for chunk in self.missing_chunks)
        return sum(stop - start for start, stop in spans)


def verify_store(directory: Path | str, progress: Advance | None = None) -> StoreReport:
    """Read a whole store and compare it with its hashes, without changing anything.

    Args:
        directory: of the store.
        progress: called with the number of chunks checked and the number to check.

    Raises:
        UserError: there is no store at ``directory``.
    """
    layout = StoreLayout(Path(directory).absolute())
    if not is_store(layout.path):
        raise UserError(f"{directory} is not a rendered dataset", "sextant data list shows the existing ones")
    try:
        manifest = read_manifest(layout.path)
    except DamagedStoreError as error:
        return StoreReport(layout.path, None, (_file_damage(layout.manifest, error),))
    records = Journal(layout.journal, manifest.grid).records()
    damaged: list[ChunkDamage] = []
    for checked, record in enumerate(records.values()):
        if progress is not None:
            progress(checked, len(records))
        damaged += _damage(layout, manifest, record)
    if progress is not None:
        progress(len(records), len(records))
    return StoreReport(
        directory=layout.path,
        manifest=manifest,
        damaged_files=tuple(_damaged_files(layout, manifest)),
        damaged_chunks=tuple(sorted(damaged, key=lambda damage: (damage.chunk, damage.array))),
        rendered_chunks=tuple(sorted(records)),
        missing_chunks=tuple(chunk for chunk in range(manifest.grid.chunks) if chunk not in records),
    )


def is_store(directory: Path) -> bool:
    """Whether a folder is a store, even a damaged one."""
    layout = StoreLayout(directory)
    return layout.manifest.is_file() or layout.journal.is_file()


def _damage(layout: StoreLayout, manifest: Manifest, record: ChunkRecord) -> Iterator[ChunkDamage]:
    for name, spec in manifest.arrays.items():
        found = None
        with suppress(OSError, DamagedStoreError):
            path = layout.array(name)
            start = array_offset(path, spec, manifest.count) + record.start * spec.item_bytes
            found = part_sha256(path, start, (record.stop - record.start) * spec.item_bytes)
        if found is None or found != record.sha256.get(name):
            yield ChunkDamage(name, record.chunk, record.start, record.stop)


def _damaged_files(layout: StoreLayout, manifest: Manifest) -> Iterator[FileDamage]:
    for name, spec in manifest.arrays.items():
        try:
            check_array(layout.array(name), spec, manifest.count)
        except DamagedStoreError as error:
            yield _file_damage(layout.array(name), error)
    for name, expected in manifest.columns.items():
        path = layout.column(name)
        try:
            found = hashlib.sha256(path.read_bytes()).hexdigest()
        except OSError as error:
            yield FileDamage(path, error.strerror or str(error))
            continue
        if found != expected:
            yield FileDamage(path, "was altered: it does not match its hash in the manifest")


def _file_damage(path: Path, error: DamagedStoreError) -> FileDamage:
    return FileDamage(path, error.problem.removeprefix(f"{path}: "))


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
    """Discard the damaged chunks of a verified store, and remove damaged files.

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


def stores_in(cache: Path) -> list[Path]:
    """The stores of a folder, including damaged ones, in the order of their names."""
    return sorted(path for path in cache.glob("*") if is_store(path))


def find_store(name: str, cache: Path) -> Path:
    """The store that ``name`` refers to: its path, the name of its folder, or of its dataset if that has one store.

    Raises:
        UserError: there is none, or several; the message names those in ``cache``.
    """
    for path in (Path(name).expanduser(), cache / name):
        if is_store(path):
            return path.absolute()
    stores = stores_in(cache)
    found = [path for path in stores if path.name.rpartition("-")[0] == name]
    if len(found) == 1:
        return found[0]
    several = ", ".join(path.name for path in found or stores) or "none"
    raise UserError(
        f"{name}: {'several stores' if found else 'no store'} of that name in {cache}", f"Stores there: {several}"
    )
