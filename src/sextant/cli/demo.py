"""``sextant demo``: demonstrate Sextant in the browser on your own photos."""

import webbrowser
from collections.abc import Sequence
from threading import Event

from pydantic import Field

from sextant.console.arguments import Options, UserPath
from sextant.console.console import console

USAGE = "sextant demo [map=<folder of photos with poses, or saved map>] [browser=false] [port=8000]"


class DemoOptions(Options):
    """What the user chose."""

    map: UserPath | None = None
    """photos with poses or a saved map, as for sextant locate, to locate photos in (default: a rendered office)"""
    browser: bool = Field(True, examples=["false"])
    """false: print the address without opening a browser"""
    port: int = Field(0, ge=0, le=65535, examples=[8000])
    """port on the loopback interface (default: a free one)"""


def main(arguments: Sequence[str]) -> None:
    """Serve the page until Ctrl-C."""
    options = DemoOptions.parse(arguments, USAGE)
    from sextant.pages.demo.app import served

    given = None
    if options.map is not None:
        from sextant.console.work_progress import work_progress
        from sextant.tools.demonstration.where_taken import WhereTaken

        with work_progress("the map's features", "images") as progress:
            given = WhereTaken.in_folder(options.map, progress)
    with served(options.port, given) as address:
        console.print(f"[bold]{address}[/]  (Ctrl-C ends it; nothing leaves this machine, and no photo is kept)")
        if options.browser and not webbrowser.open(address):
            console.print("no browser was found here: open the address in one")
        Event().wait()
