"""Rendering chunks in several threads and writing each to disk before it is journalled."""

from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path

import numpy as np

from sextant.data.rendered.disk import reporting_disk_errors, write_at
from sextant.data.rendered.journal import ChunkRecord
from sextant.data.rendered.layout import StoreLayout
from sextant.data.rendered.manifest import Manifest
from sextant.data.rendered.plan import RenderPlan, check_chunk


class ChunkWriter:
    """Renders one chunk at a time, from any thread, and writes it into the arrays of a store.

    Args:
        directory: of the store.
        manifest: of the store.
        plan: renders the items.
        offsets: where the items of each array begin in its file.
        needed: returns the bytes still to be written, for the message that the disk is full.
    """

    def __init__(
        self,
        directory: Path,
        manifest: Manifest,
        plan: RenderPlan,
        offsets: Mapping[str, int],
        needed: Callable[[], int],
    ):
        self._layout = StoreLayout(directory)
        self._manifest = manifest
        self._plan = plan
        self._offsets = offsets
        self._needed = needed

    def write(self, chunk: int) -> ChunkRecord:
        """Render a chunk and write it to disk; the caller then journals it.

        Raises:
            UserError: the disk refused. Only write errors are converted; the renderer's own errors propagate unchanged.
            ValueError: the rendered arrays do not match the plan.
        """
        start, stop = self._manifest.grid.span(chunk)
        arrays = self._manifest.arrays
        found = self._plan.render(start, stop)
        check_chunk(self._manifest.name, found, arrays, stop - start)
        hashes = {}
        with reporting_disk_errors(self._layout.path, self._needed):
            for name, spec in arrays.items():
                offset = self._offsets[name] + start * spec.item_bytes
                hashes[name] = write_at(self._layout.array(name), offset, np.ascontiguousarray(found[name]))
        return ChunkRecord(chunk, start, stop, hashes)


def written_chunks(writer: ChunkWriter, chunks: Sequence[int], threads: int) -> Generator[ChunkRecord, None, None]:
    """Write chunks, started in order, and yield each once it is on disk.

    At most ``threads`` chunks are in memory at a time. If it is stopped early (an error, Ctrl-C, closed), it starts no
    further chunk and waits for those under way without yielding them: the next call renders them again.

    Raises:
        UserError: the disk refused a chunk.
    """
    if threads == 1 or len(chunks) == 1:
        yield from map(writer.write, chunks)
        return
    waiting = iter(chunks)
    with ThreadPoolExecutor(threads, thread_name_prefix="render") as pool:
        running: set[Future[ChunkRecord]] = set()
        try:
            while True:
                while len(running) < threads and (chunk := next(waiting, None)) is not None:
                    running.add(pool.submit(writer.write, chunk))
                if not running:
                    return
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        finally:
            for future in running:
                future.cancel()
