"""A small office by day and by night, rendered once for all tests of a session, and quick runs in it."""

from pathlib import Path

from sextant.cli.compose import compose, to_plain

LASER = "{beams: 60, field_of_view_rad: 3.14159, max_range_m: 15.0, range_sigma_m: 0.02, dropout: 0.01}"
#: 250 images of the map, 100 for validation and 120 for the test, by each of two lights
OFFICE = (
    "dataset=office_walk", "dataset.size_m=[14.0, 12.0]", "dataset.metres=[40.0, 8.0, 16.0]", "dataset.every=4",
    "dataset.width=24", "dataset.height=16", "dataset.samples=1", "dataset.conditions=[summer_noon, night_clear]",
    f"dataset.laser={LASER}",
)  # fmt: skip
QUICK = (
    "task.starts=3", "task.horizon=30", "task.replay=false", "task.save_map=false", "filter.particles=200",
    "descriptor.height=16", "descriptor.width=24", "descriptor.dimensions=16", "trainer.max_epochs=2",
    "trainer.progress=false", "tracking=none",
)  # fmt: skip


def office_cache(tmp_path_factory) -> Path:
    """The folder that the office is rendered into, and descriptors are kept in."""
    return tmp_path_factory.getbasetemp() / "tiny_office"


def office_arguments(cache: Path, outputs: Path, *overrides: str) -> list[str]:
    """The command line of a run; ``overrides`` take the place of what is usual."""
    given = {override.partition("=")[0].lstrip("+") for override in overrides}
    usual = ["task=localization", *OFFICE, *QUICK, f"paths.cache={cache}", f"paths.outputs={outputs}"]
    groups = {name for name in given if "." not in name}
    kept = [each for each in usual if each.partition("=")[0] not in given and each.partition(".")[0] not in groups]
    return [*kept, *overrides]


def office_config(cache: Path, outputs: Path, *overrides: str) -> dict:
    """The plain config of a run."""
    return to_plain(compose(office_arguments(cache, outputs, *overrides)))
