"""``sextant demo``: demonstrate Sextant in the browser on your own photos."""

import webbrowser
from collections.abc import Sequence
from threading import Event

from pydantic import Field

from sextant.console.arguments import Options
from sextant.console.console import console

USAGE = "sextant demo [browser=false] [port=8000]"


class DemoOptions(Options):
    """What the user chose."""

    browser: bool = Field(True, examples=["false"])
    """false: print the address without opening a browser"""
    port: int = Field(0, ge=0, le=65535, examples=[8000])
    """port on the loopback interface (default: a free one)"""


def main(arguments: Sequence[str]) -> None:
    """Serve the page until Ctrl-C."""
    options = DemoOptions.parse(arguments, USAGE)
    from sextant.pages.demo.app import served

    with served(options.port) as address:
        console.print(f"[bold]{address}[/]  (Ctrl-C ends it; nothing leaves this machine, and no photo is kept)")
        if options.browser and not webbrowser.open(address):
            console.print("no browser was found here: open the address in one")
        Event().wait()
