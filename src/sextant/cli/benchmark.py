"""``sextant benchmark calibration``: all methods on photos with known cameras, in one table."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field

from sextant.applications.arguments import check_apart
from sextant.console.arguments import SPLIT, Options, UserPath
from sextant.console.console import console
from sextant.console.written import make_output, tell_skipped, tell_written
from sextant.errors import UserError

USAGE = "sextant benchmark calibration folder=<folder, or its name in SEXTANT_DATA> [run=<run>] [output=<folder>]"


class BenchmarkOptions(Options):
    """What the user chose."""

    folder: UserPath
    """photos with a table of their cameras, or panoramas: a path, or a name in SEXTANT_DATA such as york_urban"""
    run: str = "zoo:calibration"
    """the network: a calibration run or a checkpoint (default: the one included in the package)"""
    sampling: str = "lopez_4x3"
    """camera distribution for the photos cut from panoramas (default: lopez_4x3)"""
    cuts: Annotated[int, Field(ge=1)] = 7
    """number of photos cut from each panorama (default: 7)"""
    leave_out: Annotated[tuple[str, ...], SPLIT] = ()
    """files to exclude, such as training data: names or patterns like polyhaven__*, separated by commas"""
    output: UserPath = Path("benchmark")
    """folder for the tables and the errors of each photo (default: benchmark)"""


def main(arguments: Sequence[str]) -> None:
    """Run the benchmark, and show and write its tables."""
    if not {"calibration", "-h", "--help"} & set(arguments):
        raise UserError("benchmark: name what to measure", USAGE)
    options = BenchmarkOptions.parse([each for each in arguments if each != "calibration"], USAGE)
    check_apart(options.output, folder=options.folder)
    make_output(options.output)
    from sextant.applications import PhotoCalibrator
    from sextant.lifecycle.photo_benchmark import benchmark_calibration, write_benchmark

    data = Path(os.environ.get("SEXTANT_DATA", "")) / options.folder
    folder = options.folder if options.folder.is_dir() else data
    with console.status("photos") as status:
        found = benchmark_calibration(
            PhotoCalibrator.load(options.run), folder, sampling=options.sampling, cuts=options.cuts,
            leave_out=options.leave_out, progress=lambda done: status.update(f"{done} photos"),
        )  # fmt: skip
    console.print(found.markdown())
    tell_skipped(found.skipped)
    written = write_benchmark(found, options.output)
    tell_written(f"{len(found.names)} photos measured", len(found.skipped), written, "left out")
