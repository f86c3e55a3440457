"""Progress messages of long work for its caller: passed in as an argument, silent by default."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

#: called with how much is done and the total
Advance = Callable[[int, int], None]
#: makes a context whose value is an :data:`Advance`, from the kind of work and the unit that is counted
Progress = Callable[[str, str], AbstractContextManager[Advance]]


class Reporter:
    """Receives messages from long work. This one shows nothing; that of the command line writes to the terminal."""

    def say(self, text: str) -> None:
        """Report a remark that is worth a line."""

    def progress(self, what: str, unit: str) -> AbstractContextManager[Advance]:
        """A context whose value is called with the progress of the work.

        Args:
            what: what is being done, such as ``rendering``.
            unit: what is counted, such as ``images``.
        """
        return nullcontext(lambda done, total: None)


SILENT = Reporter()
