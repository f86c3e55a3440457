"""Mutual exclusion of processes, on one host or on several that share a disk.

A lease is a numbered file; the highest number holds it. The file is finished first and then linked to its name. Only
one process can succeed in that, also over NFS, where file locks may not reach other hosts. The holder touches its file
regularly. The lease is free once its file is deleted, once the holder's process has died (if it ran on this host),
or once the file has not been touched for as long as it states. Both times are the disk's; no host's clock is used.

flufl.lock was not used: its locks expire by the hosts' clocks, nothing renews them automatically, and they need hard
links.
"""

import ctypes
import errno
import json
import os
import socket
import subprocess
import threading
import time
import uuid
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

#: how long a lease that is not touched remains valid, in seconds
LEASE_S = 60.0
BEATS = 6  # touches within that time
#: how long a file that cannot be parsed may still be in the middle of being written, in seconds
WRITING_S = 5.0
POLL_S = 0.05
#: errors for a file that another host has deleted
GONE = (errno.ENOENT, errno.ESTALE)
PROC = Path("/proc")  # Linux only
ONE_TIME = {"LC_ALL": "C", "TZ": "UTC"}  # so that two processes print the same time in the same words
NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK)


@dataclass(frozen=True)
class Holder:
    """The process that holds, or held, a lease.

    Attributes:
        host: name of its host.
        place: identifies the host, or the container on a host, to which the process id belongs.
        process: process id there.
        began: start of the process, in ticks of its host's clock, since process ids are reused.
        lease_s: how long the lease lasts without being touched, in seconds.
    """

    host: str
    place: str
    process: int
    began: str
    lease_s: float

    def __str__(self) -> str:
        return f"process {self.process} on {self.host}"

    @property
    def here(self) -> bool:
        """Whether the process, if alive, would be among the processes of this host."""
        return self.place == _place()


class Lease:
    """A lease that this process holds; see :func:`take`.

    Attributes:
        lost: another process took the lease over, since this one had been silent for too long. What the lease protects
            must not be written to any more; the thread that took the lease gets a ``KeyboardInterrupt``.
    """

    def __init__(self, path: Path, lease_s: float):
        self.path, self.lost = path, False
        self._taker = threading.get_ident()
        self._released = threading.Event()
        self._thread = threading.Thread(target=self._beat, args=(lease_s / BEATS,), daemon=True, name="lease")
        self._thread.start()

    def release(self) -> None:
        """Give the lease back."""
        self._released.set()
        self._thread.join()
        if not self.taken_over():
            with suppress(OSError):
                self.path.unlink()

    def taken_over(self) -> bool:
        """Check whether another process holds the lease now."""
        successor = self.path.with_name(str(int(self.path.name) + 1))
        try:
            self.lost = self.lost or successor.exists() or self.path.stat().st_mtime == 0
        except FileNotFoundError:  # removed by a later holder, unless somebody deleted the whole folder
            self.lost = self.path.parent.is_dir()
        except OSError:  # the disk cannot be reached: keep the last known state
            return self.lost
        return self.lost

    def _beat(self, every_s: float) -> None:
        while not self._released.wait(every_s):
            if self.taken_over():
                interrupt = ctypes.py_object(KeyboardInterrupt)
                ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self._taker), interrupt)
                return
            with suppress(OSError):
                os.utime(self.path)


def take(folder: Path, lease_s: float = LEASE_S) -> Lease | Holder:
    """Take the lease in ``folder``, or return who holds it.

    Args:
        folder: folder for this lease alone; created if it does not exist.
        lease_s: how long the lease lasts, in seconds, once this process or its host falls silent.

    Raises:
        OSError: the folder cannot be written to.

    Example:
        >>> from tempfile import mkdtemp
        >>> folder = Path(mkdtemp())
        >>> lease = take(folder)
        >>> isinstance(take(folder), Holder)
        True
        >>> lease.release()
    """
    folder.mkdir(parents=True, exist_ok=True)
    while True:
        number, holder = _latest(folder)
        if holder is not None and _alive(folder / str(number), holder):
            return holder
        mine = folder / str(number + 1)
        if not _made(mine, Holder(socket.gethostname(), _place(), os.getpid(), _began(os.getpid()), lease_s)):
            continue
        if max(_numbers(folder)) != number + 1:  # the reading above is outdated: others have held the lease since
            mine.unlink(missing_ok=True)
            continue
        if number:  # so that a stalled holder notices when it resumes, even if its successor has ended
            with suppress(OSError):
                os.utime(folder / str(number), (0, 0))
        for older in _numbers(folder):
            if older < number:
                (folder / str(older)).unlink(missing_ok=True)
        return Lease(mine, lease_s)


def look(folder: Path) -> tuple[Holder, bool] | None:
    """The last holder of the lease in ``folder`` and whether it still holds; None if never taken or given back."""
    if not folder.is_dir():
        return None
    number, holder = _latest(folder)
    return None if holder is None else (holder, _alive(folder / str(number), holder))


def _numbers(folder: Path) -> list[int]:
    return sorted(int(entry.name) for entry in os.scandir(folder) if entry.name.isdecimal())


def _latest(folder: Path) -> tuple[int, Holder | None]:
    """The highest number, 0 if there is none, and who wrote it."""
    for number in reversed(_numbers(folder)):
        try:
            return number, _read(folder / str(number))
        except OSError as error:  # given back meanwhile; if unreadable for another reason, it may well be held
            if error.errno not in GONE:
                raise
    return 0, None


def _read(file: Path) -> Holder | None:
    """The holder named in a file; None if the file is damaged, so that nobody holds it."""
    while True:
        try:
            return Holder(**json.loads(file.read_text()))
        except (ValueError, TypeError):
            if _silent_s(file) > WRITING_S:
                return None
        time.sleep(POLL_S)


def _alive(file: Path, holder: Holder) -> bool:
    if holder.here:
        return _began(holder.process) == holder.began
    try:
        return _silent_s(file) < holder.lease_s
    except FileNotFoundError:
        return False


def _silent_s(file: Path) -> float:
    """How long a file has not been touched, in seconds."""
    with file.open() as opened:  # NFS asks the server for a file's age when the file is opened
        touched = os.fstat(opened.fileno()).st_mtime
    return _disk_time(file.parent) - touched


def _disk_time(folder: Path) -> float:
    """The current time by the disk's clock."""
    probe = folder / f".now.{uuid.uuid4().hex}"
    try:
        probe.touch()
        return probe.stat().st_mtime
    finally:
        probe.unlink(missing_ok=True)


def _made(path: Path, holder: Holder) -> bool:
    """Create a file with its whole content at once; false if another process has created it."""
    temporary = path.with_name(f".{uuid.uuid4().hex}")
    text = json.dumps(asdict(holder))
    temporary.write_text(text)
    try:
        os.link(temporary, path)
    except FileExistsError:  # NFS may also report this for a link that it made on the first request
        return temporary.stat().st_nlink == 2
    except OSError as error:
        if error.errno not in NO_LINKS:
            raise
        with suppress(FileExistsError), path.open("x") as file:
            file.write(text)
            return True
        return False
    finally:
        temporary.unlink(missing_ok=True)
    return True


@cache
def _place() -> str:
    """Identifies the host, or the container on a host, to which process ids belong."""
    try:
        boot = (PROC / "sys/kernel/random/boot_id").read_text().strip()
        return f"{boot} {os.readlink(PROC / 'self/ns/pid')}"
    except OSError:
        return socket.gethostname()


def _began(process: int) -> str:
    """When a process of this host began; empty if it has ended."""
    if not PROC.is_dir():
        return _began_by_ps(process)
    try:
        fields = (PROC / str(process) / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if fields[0] in "ZX" else fields[19]


def _began_by_ps(process: int) -> str:
    """The same on macOS and the BSDs."""
    command = ["ps", "-o", "stat=,lstart=", "-p", str(process)]
    said = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **ONE_TIME})
    state, _, began = said.stdout.strip().partition(" ")
    return "" if state.startswith("Z") else began.strip()
