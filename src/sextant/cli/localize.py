"""``sextant localize``: localize the images of a folder, video, ROS bag or camera; also live."""

import webbrowser
from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from sextant.chapters.localization.options import OUTPUT, LocalizingOptions
from sextant.console.arguments import UserPath
from sextant.console.console import console
from sextant.errors import UserError
from sextant.user_files import absent

USAGE = (
    "sextant localize map=<localization run or saved map> input=<folder of photos, video, ROS bag or camera:0> "
    "[live=true] [odometry=<table>] [output=localization]"
)


class LocalizeOptions(LocalizingOptions):
    """What the user chose."""

    map: str
    """a localization run, or a folder written by Localizer.save or sextant walk"""
    input: str
    """folder of photos in order of file name, a video, a ROS bag, or camera:0 for this machine's first camera"""
    output: UserPath = Path(OUTPUT)
    """folder for poses.csv, trajectory.tum and pictures (default: localization)"""
    live: bool = Field(False, examples=["true"])
    """true: show each step live in the browser"""
    browser: bool = Field(True, examples=["false"])
    """with live=true: false prints the address without opening a browser"""
    port: int = Field(0, ge=0, le=65535, examples=[8000])
    """with live=true: port on the loopback interface (default: a free one)"""
    trust: bool = Field(False, examples=["true"])
    """true: build user-defined parts that the map names"""


def main(arguments: Sequence[str]) -> None:
    """Localize the images, show them live if requested, and print where the results are."""
    for word in arguments:
        if word.startswith("run="):
            raise UserError(f"{word}: give the run as the map", f"map={word[4:]}")
    options = LocalizeOptions.parse(arguments, USAGE)
    if not options.live and (unused := [word for word in arguments if word.startswith(("port=", "browser="))]):
        raise UserError(f"{unused[0]} needs live=true", f"Add live=true, or leave out {unused[0]}")
    from sextant.applications.arguments import check_apart
    from sextant.chapters.localization.found_map import find_map
    from sextant.chapters.localization.predict import predict_poses
    from sextant.console.written import make_output
    from sextant.runs.outputs_folder import default_outputs
    from sextant.runs.resolve import resolve_run

    folder = find_map(options.map, default_outputs())
    if folder is None:
        path = Path(options.map).expanduser()
        try:
            resolve_run(options.map, default_outputs())
            why = ""  # of another task
        except UserError:
            why = "" if path.exists() else f"; {absent(path)}"
        raise UserError(
            f"map={options.map}: neither a saved map nor a run of localization, nor zoo:office{why}",
            "Localizer.from_images(images, poses).save(folder) makes one; so does sextant walk from images with poses.",
        )
    check_apart(options.output, input=options.input, map=folder)
    make_output(options.output)
    more = {}
    if options.live:
        from sextant.pages.drive.serving import watched

        more = {"watched": lambda localizer: watched(localizer, options.port, lambda address: _tell(address, options))}
    predict_poses(folder, options.input, options.output, options, trust=options.trust, **more)


def _tell(address: str, options: LocalizeOptions) -> None:
    console.print(f"[bold]{address}[/]  (Ctrl-C ends the drive, and what was localized is written)")
    if options.browser and not webbrowser.open(address):
        console.print("no browser was found here: open the address in one")
