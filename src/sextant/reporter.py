"""What long work says while it goes on, to whoever started it: handed in, and silent unless somebody listens."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

#: called with how much is done, and with all there is
Advance = Callable[[int, int], None]
#: given what is done and the unit of what is counted, a context whose value is an :data:`Advance`
Progress = Callable[[str, str], AbstractContextManager[Advance]]


class Reporter:
    """Listens to long work. This one shows nothing; the command line's writes to the terminal."""

    def say(self, text: str) -> None:
        """A remark worth a line."""

    def progress(self, what: str, unit: str) -> AbstractContextManager[Advance]:
        """A context whose value is called with how far the work is.

        Args:
            what: is done, such as ``rendering``.
            unit: of what is counted, such as ``images``.
        """
        return nullcontext(lambda done, total: None)


SILENT = Reporter()
