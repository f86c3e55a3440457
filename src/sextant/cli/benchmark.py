"""``sextant benchmark calibration``: all methods on photos with known cameras, in one table."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field

from sextant.applications.arguments import check_apart
from sextant.chapters.calibration.options import NetworkOptions
from sextant.console.arguments import SPLIT, UserPath, parse_arguments
from sextant.console.console import console
from sextant.console.written import make_output, tell_skipped, tell_written
from sextant.errors import UserError
from sextant.tables import counted

USAGE = (
    "sextant benchmark calibration folder=<folder, or its name in SEXTANT_DATA> "
    "[run=<run>, or network=<geocalib or anycalib>:<file>] [output=<folder>]"
)
#: file of the scale that is fitted to a network of others
SCALE = "network_scale.json"


class BenchmarkOptions(NetworkOptions):
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
    own = [each for each in arguments if each != "calibration"]
    given = parse_arguments(own, BenchmarkOptions.meanings(), USAGE)
    options = BenchmarkOptions.of(given, USAGE)
    if options.network is not None and "run" in given:
        raise UserError(f"run={options.run} and network={options.network} are two networks", "Leave out one.")
    if options.network is None and options.scale is not None:
        raise UserError(f"scale={options.scale} is for a network of others", USAGE)
    check_apart(options.output, folder=options.folder)
    make_output(options.output)
    from sextant.applications import PhotoCalibrator
    from sextant.chapters.calibration.predict import calibrator_of_others
    from sextant.lifecycle.photo_benchmark import benchmark_calibration, write_benchmark, write_network_scale

    data = Path(os.environ.get("SEXTANT_DATA", "")) / options.folder
    folder = options.folder if options.folder.is_dir() else data
    calibrator = PhotoCalibrator.load(options.run) if options.network is None else calibrator_of_others(options)
    with console.status("photos") as status:
        found = benchmark_calibration(
            calibrator, folder, sampling=options.sampling, cuts=options.cuts,
            leave_out=options.leave_out, progress=lambda done: status.update(f"{counted(done, 'photo')}"),
        )  # fmt: skip
    console.print(found.markdown(), markup=False)
    if "cuts" in options.model_fields_set and not any("#" in name for name in found.names):
        console.print(f"note: cuts={options.cuts} is for panoramas, of which this folder has none")
    tell_skipped(found.skipped)
    written = write_benchmark(found, options.output)
    if options.network is not None and options.scale is None:
        text, file = write_network_scale(found, calibrator, options.output / SCALE)
        console.print(text, markup=False)
        written.append(file)
    tell_written(f"{counted(len(found.names), 'photo')} measured", len(found.skipped), written, "left out")
