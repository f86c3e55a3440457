"""The most memory that a run had resident: a process that does one run after the other counts each anew."""

import resource
from contextlib import suppress
from pathlib import Path

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def reset_peak_memory() -> None:
    """Count from what is resident now; where the system cannot do that, the peak stays that of the process."""
    with suppress(OSError):
        _RESET.write_text("5")


def peak_memory_mb() -> float:
    """Most MB (2^20 bytes) resident since the last reset, or since the process began."""
    with suppress(OSError, ValueError, IndexError):
        (line,) = (line for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
