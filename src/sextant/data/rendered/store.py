"""A rendered dataset on disk: read lazily, rendered once, resumed after any interruption."""

import hashlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from functools import cached_property
from io import BytesIO
from pathlib import Path
from threading import Lock
from typing import Any, TypeAlias

import numpy as np
from numpy import ndarray

from sextant.atomic_files import write_atomically
from sextant.data.rendered.disk import DiskFullError, allocated_bytes, free_bytes, reporting_disk_errors
from sextant.data.rendered.journal import Journal
from sextant.data.rendered.layout import DamagedStoreError, StoreLayout, check_array, make_arrays, part_sha256
from sextant.data.rendered.lock import Notify, log, store_lock
from sextant.data.rendered.manifest import Manifest, manifest_of, read_manifest, write_manifest
from sextant.data.rendered.plan import RenderPlan, check_plan
from sextant.data.rendered.rendering import ChunkWriter, written_chunks
from sextant.errors import UserError, command
from sextant.reporter import Advance

#: One index, a slice, several indices, or a mask over all items.
Indices: TypeAlias = int | slice | Sequence[int] | ndarray


def chosen_items(indices: Indices, count: int) -> ndarray:
    """Indices as an array, each from 0 to ``count - 1``; of dimension 0 for a single one.

    Raises:
        IndexError: an index is out of range or not an integer.
    """
    if not isinstance(indices, slice):
        indices = np.asarray(indices)
        if indices.size == 0:  # an empty list becomes floating-point
            indices = indices.astype(np.int64)
    return np.asarray(np.arange(count)[indices])


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


def open_store(plan: RenderPlan, cache: Path | str, *, notify: Notify = log.info) -> "RenderedStore":
    """Open the store of a plan below ``cache``; if it does not exist yet, it is laid out with nothing rendered.

    An existing store is opened without building the plan's world.

    Args:
        plan: what to render.
        cache: folder of stores.
        notify: receives a message when this process waits for another.

    Raises:
        UserError: the folder cannot be written to, or the disk is full.
        DamagedStoreError: a file of the store is damaged; the message names it and the command that repairs it.
    """
    directory = Path(cache).absolute() / f"{plan.name}-{plan.digest[:8]}"
    if not StoreLayout(directory).manifest.is_file():
        create_store(directory, plan, notify)
    store = RenderedStore(directory, plan, notify)
    if store.digest != plan.digest:
        path = StoreLayout(directory).manifest
        raise DamagedStoreError.at(path, f"has the digest {store.digest[:16]}, the config requires {plan.digest[:16]}")
    return store


def load_store(directory: Path | str, *, notify: Notify = log.info) -> "RenderedStore":
    """Open a store as it is on disk, without its renderer: what is not rendered cannot be read.

    Raises:
        DamagedStoreError: a file of the store is damaged; the message names it and the command that repairs it.
    """
    return RenderedStore(Path(directory).absolute(), None, notify)


class RenderedStore:
    """Items by index; those not yet on disk are rendered when first read.

    Any number of processes and threads may read and fill a store: each chunk is rendered by one of them. A store can be
    pickled if its plan can; unpickling opens it again.

    Attributes:
        directory: its folder.
        manifest: what it holds.
    """

    def __init__(self, directory: Path, plan: RenderPlan | None, notify: Notify = log.info):
        self.directory = directory
        self.manifest: Manifest = read_manifest(directory)
        self._plan = plan
        self._notify = notify
        self._layout = StoreLayout(directory)
        self._offsets = {
            name: check_array(self._layout.array(name), spec, len(self)) for name, spec in self.manifest.arrays.items()
        }
        self._journal = Journal(self._layout.journal, self.manifest.grid)
        self._maps: dict[str, ndarray] = {}
        self._sound = {name: np.zeros(self.manifest.grid.chunks, bool) for name in self.manifest.arrays}
        self._rendering = Lock()
        self._refresh()

    def __reduce__(self) -> tuple[type["RenderedStore"], tuple[Path, RenderPlan | None, Notify]]:
        return type(self), (self.directory, self._plan, self._notify)

    def __len__(self) -> int:
        return self.manifest.count

    @property
    def digest(self) -> str:
        """SHA-256 of config and source, which changes when the rendered data would."""
        return self.manifest.digest

    @property
    def facts(self) -> dict[str, Any]:
        """The manifest's facts about the dataset."""
        return dict(self.manifest.facts)

    @cached_property
    def columns(self) -> dict[str, ndarray]:
        """Small arrays ``(count, ...)``, held in memory.

        Raises:
            DamagedStoreError: a column's file is missing or altered.
        """
        found = {}
        for name, expected in self.manifest.columns.items():
            path = self._layout.column(name)
            try:
                content = path.read_bytes()
            except OSError as error:
                raise DamagedStoreError.at(path, error.strerror or str(error)) from None
            if hashlib.sha256(content).hexdigest() != expected:
                raise DamagedStoreError.at(path, "was altered: it does not match its hash in the manifest")
            found[name] = np.load(path, allow_pickle=False)
        return found

    @property
    def rendered(self) -> int:
        """Number of items on disk, whichever process rendered them."""
        self._refresh()
        last, short = self.manifest.grid.chunks - 1, -len(self) % self.manifest.chunk
        return int(self._rendered.sum()) * self.manifest.chunk - (short if self._rendered[last] else 0)

    @property
    def complete(self) -> bool:
        """Whether every item is on disk."""
        return bool(self._rendered.all()) or self.rendered == len(self)

    def on_disk(self) -> ndarray:
        """For each chunk, whether it is rendered."""
        self._refresh()
        return self._rendered

    def fill(self, progress: Advance | None = None, threads: int = 1, *, chunks: Sequence[int] | None = None) -> int:
        """Render what is missing and return the number of items this process rendered.

        It waits while another process renders, and takes over if that one dies. If killed at any moment, it loses only
        the chunks under way; the next call resumes.

        Args:
            progress: called with the numbers of items on disk and in all, at the start and after every chunk.
            threads: chunks rendered at a time, each held in memory. Any number gives the same bytes.
            chunks: chunks to render; by default all.

        Raises:
            DiskFullError: there is not enough space for the rest, or the disk filled up; what was rendered is kept.
            UserError: the folder cannot be written to.
        """
        chosen = range(self.manifest.grid.chunks) if chunks is None else chunks
        return self._render(chosen, threads, progress or _ignore)

    def read(self, array: str, indices: Indices) -> ndarray:
        """Read items of one array, copied into memory; missing chunks are rendered first.

        Args:
            array: name of an array, or of a column.
            indices: one index, which gives one item ``(*shape)``, or several, which give ``(n, *shape)``.

        Raises:
            KeyError: there is no such array.
            IndexError: an index is out of range.
            UserError: as for :meth:`fill`, or the store was opened without its renderer.
        """
        chosen = chosen_items(indices, len(self))
        if array in self.manifest.columns:
            return np.asarray(np.take(self.columns[array], chosen, axis=0))
        if array not in self.manifest.arrays:
            names = ", ".join([*self.manifest.arrays, *self.manifest.columns])
            raise KeyError(f"{self.manifest.name} has no array {array!r}; arrays are {names}")
        return np.asarray(np.take(self.mapped(array, chosen), chosen, axis=0))

    def mapped(self, array: str, rows: ndarray, threads: int = 1) -> ndarray:
        """A whole array, memory-mapped from its file, of which ``rows`` are rendered and sound.

        Each chunk is compared with its hash when first requested, and only then.

        Args:
            array: its name.
            rows: items that will be used; the content of others is undefined.
            threads: number of reading threads.

        Raises:
            DamagedStoreError: a chunk is not what was rendered.
            UserError: as for :meth:`read`.
        """
        chunks = np.unique(np.asarray(rows) // self.manifest.chunk)
        self._ensure(chunks)
        self._compare(array, chunks[~self._sound[array][chunks]].tolist(), threads)
        return self._map(array)

    def __getitem__(self, index: int) -> dict[str, ndarray]:
        return {name: self.read(name, index) for name in (*self.manifest.arrays, *self.manifest.columns)}

    def _compare(self, array: str, chunks: Sequence[int], threads: int) -> None:
        """Raise a ``DamagedStoreError`` unless the chunks of an array match the journal."""
        if not chunks:
            return
        path, records = self._layout.array(array), self._journal.records()
        size, offset = self.manifest.arrays[array].item_bytes, self._offsets[array]

        def compare(chunk: int) -> None:
            start, stop = self.manifest.grid.span(chunk)
            try:
                found = part_sha256(path, offset + start * size, (stop - start) * size)
            except OSError as error:
                raise DamagedStoreError.at(path, error.strerror or str(error)) from None
            if chunk not in records or found != records[chunk].sha256.get(array):
                raise DamagedStoreError.at(path, f"items {start} to {stop - 1} are not those that were rendered")
            self._sound[array][chunk] = True

        with ThreadPoolExecutor(threads) as pool:  # hashing releases the interpreter lock
            for _ in pool.map(compare, chunks):
                pass

    def _ensure(self, chunks: ndarray) -> None:
        if self._rendered[chunks].all():
            return
        self._refresh()
        missing = chunks[~self._rendered[chunks]].tolist()
        if missing:
            self._render(missing, 1, _ignore)

    def _refresh(self) -> None:
        self._rendered = self._journal.on_disk()

    def _missing(self, chunks: Sequence[int]) -> list[int]:
        self._refresh()
        return [chunk for chunk in chunks if not self._rendered[chunk]]

    def _render(self, chunks: Sequence[int], threads: int, progress: Advance) -> int:
        """Render the missing ones among ``chunks``, under the store's lock."""
        if not self._missing(chunks):
            progress(self.rendered, len(self))
            return 0
        if self._plan is None:
            raise UserError(
                f"{self.directory}: {self.rendered:,} of {len(self):,} items are rendered, but others are requested",
                f"{command('data', 'render', f'dataset={self.manifest.name}')} renders the rest.",
            )
        made = 0

        def ready() -> bool:
            missing = self._missing(chunks)
            progress(self.rendered, len(self))
            return not missing

        with self._rendering, store_lock(self.directory, ready, self._notify) as held:
            missing = self._missing(chunks) if held else []
            if missing:
                made = self._render_missing(missing, self._plan, threads, progress)
        return made

    def _render_missing(self, missing: Sequence[int], plan: RenderPlan, threads: int, progress: Advance) -> int:
        def needed() -> int:
            return self._needed(self._missing(missing))

        if needed() > free_bytes(self.directory):
            raise DiskFullError.at(self.directory, needed())
        with reporting_disk_errors(self.directory, needed):
            self._journal.cut_torn_line()
        progress(self.rendered, len(self))
        made = 0
        writer = ChunkWriter(self.directory, self.manifest, plan, self._offsets, needed)
        with closing(written_chunks(writer, missing, threads)) as records:
            for record in records:
                with reporting_disk_errors(self.directory, needed):
                    self._journal.append(record)
                made += record.stop - record.start
                progress(self.rendered, len(self))
        return made

    def _needed(self, chunks: Sequence[int]) -> int:
        """Bytes still to be allocated for these chunks: a sparse file takes less than its size."""
        spans = [self.manifest.grid.span(chunk) for chunk in chunks]
        missing = sum(stop - start for start, stop in spans) * self.manifest.item_bytes
        holes = len(self) * self.manifest.item_bytes - allocated_bytes(map(self._layout.array, self.manifest.arrays))
        return min(missing, max(0, holes))

    def _map(self, array: str) -> ndarray:
        if array not in self._maps:
            path = self._layout.array(array)
            check_array(path, self.manifest.arrays[array], len(self))  # a map beyond the file's end kills the process
            self._maps[array] = np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
        return self._maps[array]


def _ignore(rendered: int, count: int) -> None:
    """Show no progress."""
