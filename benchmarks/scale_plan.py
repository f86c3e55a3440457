"""A plan for a map of 100 million images: constants of one machine, a simulated cluster, and a map larger than memory.

``python -m benchmarks.scale_plan``                      constants of this machine, and the simulated cluster
``python -m benchmarks.scale_plan csv=<file>``           the same, and the table as a file
``python -m benchmarks.scale_plan mapped=<folder>``      a map in files: resident memory while localizing with it
``python -m benchmarks.scale_plan mapped=<folder> images=1000000``

The cluster is :mod:`benchmarks.shard_simulation`, the map in files :mod:`benchmarks.mapped_map`. See
``results/localization_city.md``.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

import torch
from rich.console import Console
from rich.table import Table

from benchmarks.localization import KERNEL as CITY_KERNEL
from benchmarks.localization import LIKELIHOOD, NEIGHBOURS, city
from benchmarks.machine import describe_machine
from benchmarks.mapped_map import IMAGES, show_mapped
from benchmarks.shard_simulation import ASSUMED, MAP_IMAGES, Constants, Outcome, measure, plans, simulate
from sextant.atomic_files import write_csv
from sextant.console.arguments import parse_arguments
from sextant.errors import UserError
from sextant.localization.appearance_proposal import AppearanceProposal
from sextant.localization.observation.cached_local_gp import CachedLocalGP

USAGE = "python -m benchmarks.scale_plan [csv=<file>]\npython -m benchmarks.scale_plan mapped=<folder> [images=1000000]"
KEYS = {
    "csv": "file for the simulated plans",
    "mapped": "folder for a map in files, about 1.3 KB per image",
    "images": f"number in that map; {IMAGES:,} by default",
}
#: Images on which constants are measured, and shards that they are split into for comparing evidence.
MEASURED, SHARDS = 172_000, 8


def main(arguments: Sequence[str]) -> None:
    console = Console(width=140)
    torch.set_num_threads(1)
    try:
        given = parse_arguments(arguments, KEYS, USAGE)
        if "mapped" in given:
            images = given.get("images", str(IMAGES))
            if not images.isdecimal() or int(images) < 1:
                raise UserError(f"images: {images!r} is not a whole number from 1 on", USAGE)
            console.print(describe_machine())
            return show_mapped(Path(given["mapped"]).expanduser(), int(images), console)
    except UserError as error:
        raise SystemExit(str(error)) from None
    model = CachedLocalGP(NEIGHBOURS, map_evidence="mean").fit(city(MEASURED), CITY_KERNEL)
    constants = measure(model)
    console.print(describe_machine())
    console.print(as_lines("measured", constants, MEASURED))
    console.print(f"assumed: {ASSUMED}", highlight=False)
    console.print(f"combined evidence of {SHARDS} shards minus that of the whole map: {shards_apart(model):.1e} nats")
    outcomes = [simulate(plan, constants) for plan in plans()]
    console.print(as_table(outcomes))
    if "csv" in given:
        columns = [field.name for field in fields(Outcome)]
        write_csv(Path(given["csv"]).expanduser(), columns, map(asdict, outcomes))
    return None


def shards_apart(model: CachedLocalGP) -> float:
    """The difference of log Z from the sums of shards from log Z of the whole map."""
    over_map = model.observe(model.map.descriptors[:1] + 0.01, LIKELIHOOD).over_map()
    whole = AppearanceProposal.of(over_map).log_evidence
    sums = torch.stack([AppearanceProposal.of(part).log_total for part in over_map.chunk(SHARDS, dim=1)])
    together = sums.logsumexp(0) - torch.tensor(float(over_map.shape[1])).double().log()
    return float((together - whole).abs().max())


def as_lines(what: str, constants: Constants, images: int) -> str:
    numbers = ", ".join(f"{name} {value:.4g}" for name, value in asdict(constants).items())
    return f"{what} on {images:,} images: {numbers}"


def as_table(outcomes: Sequence[Outcome]) -> Table:
    table = Table(title=f"{MAP_IMAGES:,} images")
    names = ("proposal", "shards", "replicas", "nodes", "GB/node", "cost/h", "busy")
    for name in (*names, "step p50 ms", "p99 ms", "restart p50 ms", "p99 ms", "all shards"):
        table.add_column(name, justify="right")
    for one in outcomes:
        latencies = (one.p50_ms, one.p99_ms, one.restart_p50_ms, one.restart_p99_ms)
        table.add_row(
            one.proposal, str(one.shards), str(one.replicas), str(one.nodes), f"{one.gb_a_node:.1f}",
            f"{one.per_hour:.0f}", f"{one.busy:.2f}", *(_milliseconds(value, one) for value in latencies),
            f"{100 * one.complete:.2f} %",
        )  # fmt: skip
    return table


def _milliseconds(value: float, outcome: Outcome) -> str:
    return "overloaded" if outcome.overloaded else "" if math.isnan(value) else f"{value:.1f}"


if __name__ == "__main__":
    main(sys.argv[1:])
