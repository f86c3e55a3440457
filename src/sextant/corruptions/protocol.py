"""The protocol of corrupted images, without which figures cannot be compared."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from sextant.corruptions.benchmark_corruption import Mode


@dataclass(frozen=True)
class Protocol:
    """What a report has to state about corrupted images.

    >>> from sextant.corruptions import BenchmarkSuite
    >>> protocol = BenchmarkSuite("cifar10_c", ["fog"], severities=[3]).protocol
    >>> protocol.severities, protocol.rounding
    ({'fog': (3,)}, '8 bits, fraction dropped')

    Attributes:
        set: which published set.
        title: its name and source.
        severities: those tested, by corruption, in the published order.
        mode: ``faithful`` to the authors' code, ``corrected``, or ``published``: files of the authors themselves.
        rounding: how images become 8 bits, as in the published files.
        baseline: what corruption errors of the set are divided by.
        image_size: size of the images that the set was published for.
        seed: seed of all random draws.
    """

    set: str
    title: str
    severities: Mapping[str, tuple[float, ...]]
    mode: Mode | Literal["published"]
    rounding: str
    baseline: str
    image_size: int
    seed: int

    def as_dict(self) -> dict[str, Any]:
        """The protocol as a dictionary, for a file of results."""
        return asdict(self)
