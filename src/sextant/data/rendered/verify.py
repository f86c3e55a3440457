"""Checking every byte of a store against its journal and its manifest."""

import hashlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from sextant.data.rendered.journal import ChunkRecord, Journal
from sextant.data.rendered.layout import DamagedStoreError, StoreLayout, array_offset, check_array, part_sha256
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
