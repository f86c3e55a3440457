"""Peak resident memory of a run, reset for each of several runs in one process."""

import resource
from contextlib import suppress
from pathlib import Path

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def reset_peak_memory() -> None:
    """Reset the peak to what is resident now; if the system cannot do that, the peak remains that of the process."""
    with suppress(OSError):
        _RESET.write_text("5")


def peak_memory_mb() -> float:
    """Peak resident memory in MB (2^20 bytes) since the last reset, or since the process started."""
    with suppress(OSError, ValueError, IndexError):
        (line,) = (line for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
