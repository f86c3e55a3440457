"""What several tests need."""

from pathlib import Path
from typing import Any

from sextant.cli.compose import compose, to_plain

#: A run of a second or two: two epochs of the digit scans, three test conditions.
QUICK = (
    "trainer.max_epochs=2",
    "trainer.batch_size=64",
    "trainer.progress=false",
    "corruption.corruptions.gaussian.levels=[0.1]",
    "corruption.corruptions.contrast_poisson.levels=[0.5]",
    "tracking.system_metrics=false",
)


def quick_config(outputs: Path, *overrides: str) -> dict[str, Any]:
    """The plain config of a quick run that writes to ``outputs``."""
    return to_plain(compose([*QUICK, f"paths.outputs={outputs}", *overrides]))
