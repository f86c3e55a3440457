"""Locks that admit one process per run directory, across any number of hosts."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sextant.errors import UserError
from sextant.lease import LEASE_S, Holder, Lease, look, take

POLL_S = 0.5


class LockedError(UserError):
    """Another process holds the lock of a run."""


@contextmanager
def run_lock(folder: Path, name: str, wait: bool, lease_s: float = LEASE_S) -> Iterator[Lease]:
    """Hold the lock of the runs called ``name``, which is released when the process ends, however it ends.

    On this host the lock is free at once; on other hosts that share the disk, after ``lease_s`` without a sign of life.

    Args:
        folder: the task's folder of run directories.
        name: the run's name.
        wait: whether to wait for another process, as sweeps do, instead of giving up.
        lease_s: duration of the lease, in seconds.

    Raises:
        LockedError: another process holds the lock and ``wait`` is false, or it took the lock over because this process
            had stalled for too long. The message names that process.
    """
    place = _place(folder, name)
    while isinstance(lease := take(place, lease_s), Holder):
        if not wait:
            raise LockedError(
                f"{folder.name}/{name} is being run by {lease}", "Wait for it, or end it; the run can be resumed then."
            )
        time.sleep(POLL_S)
    try:
        yield lease
    except KeyboardInterrupt:
        if not lease.lost:
            raise
        found = look(place)
        raise LockedError(
            f"{folder.name}/{name} was taken over by {found[0] if found else 'another process'}: "
            f"this one gave no sign of life for {lease_s:g} s",
            "Nothing is lost: the run continues there.",
        ) from None
    finally:
        lease.release()


def run_holder(run: Path) -> tuple[Holder, bool] | None:
    """The last holder of a run directory's lock, and whether it is still alive; None if the lock was released."""
    digest, seed = run.name.split("-")[:2]
    return look(_place(run.parent, f"{digest}-{seed}"))


def sweep_holder(directory: Path) -> Holder | None:
    """The process that is working on a sweep, None if there is none."""
    found = look(_place(directory.parent, directory.name))
    return found[0] if found and found[1] else None


def _place(folder: Path, name: str) -> Path:
    return folder / ".locks" / name
