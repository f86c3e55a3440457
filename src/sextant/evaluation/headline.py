"""The headline figure of each task for tables of tasks under corruptions, under the same names in all tasks."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

CLEAN = "clean"
#: prefix of the metrics; ``test/headline/under/<corruption>`` are the means over severities
PREFIX = "test/headline"


@dataclass(frozen=True)
class Headline:
    r"""The headline figure of one run on clean test images and under each corruption.

    The relative loss of a figure x against the clean one :math:`x_0` is :math:`(x_0 - x) / x_0` if higher is better and
    :math:`(x - x_0) / x_0` if lower is better: 0 is no loss; 1 is an accuracy of zero, or twice the error.

    Attributes:
        name: of the figure, such as ``accuracy``.
        unit: ``%`` for a share, which is given in [0, 1] and shown in per cent; otherwise the unit of the values.
        better: whether higher or lower is better.
        values: figures by condition key: ``clean``, and ``corruption/severity``.

    Raises:
        ValueError: there is no clean figure.

    Example:
        >>> found = Headline("accuracy", "%", "higher", {"clean": 0.8, "fog/1": 0.6, "fog/3": 0.2, "snow/1": 0.8})
        >>> found.by_corruption()["fog"], round(found.corrupted, 2), round(found.loss(found.corrupted), 2)
        (0.4, 0.6, 0.25)
    """

    name: str
    unit: str
    better: Literal["higher", "lower"]
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        if CLEAN not in self.values:
            raise ValueError(f"the figure on clean images is missing among {', '.join(self.values) or 'none'}")

    def by_corruption(self) -> dict[str, float]:
        """The figure under each corruption, averaged over its severities; nan if any of them is nan."""
        return over_severities({key: value for key, value in self.values.items() if "/" in key})

    @property
    def corrupted(self) -> float:
        """The mean over corruptions, each of which counts the same; nan without any."""
        found = list(self.by_corruption().values())
        import numpy as np

        return float(np.mean(found)) if found else float("nan")

    def loss(self, value: float) -> float:
        """The relative loss of a figure against the clean one; nan if the clean one is zero."""
        return relative_loss(self.values[CLEAN], value, self.better)

    def metrics(self) -> dict[str, float]:
        """``clean``, ``corrupted``, ``relative_loss`` and ``under/<corruption>`` as metrics; none without corruptions.

        Figures that are nan are left out.
        """
        under = self.by_corruption()
        if not under:
            return {}
        means = {CLEAN: self.values[CLEAN], "corrupted": self.corrupted, "relative_loss": self.loss(self.corrupted)}
        found = means | {f"under/{name}": value for name, value in under.items()}
        return {f"{PREFIX}/{name}": value for name, value in found.items() if math.isfinite(value)}

    def facts(self, **more: Any) -> dict[str, Any]:
        """Metadata of the figure and a table by corruption, as stored with a run's results; empty without any."""
        if not self.by_corruption():
            return {}
        about = {"name": self.name, "unit": self.unit, "better": self.better, **more}
        return {"headline": about, "by_corruption": self.table()}

    def table(self) -> list[dict[str, str]]:
        """A row for clean images, for each corruption, and for the mean over corruptions."""
        rows = {CLEAN: self.values[CLEAN], **self.by_corruption(), "mean": self.corrupted}
        factor, column = (100, f"{self.name}, %") if self.unit == "%" else (1, self.name)
        return [
            {
                "images": name.replace("_", " "),
                column: f"{factor * value:.2f}",
                "loss, %": "–" if (loss := self.loss(value)) != loss else f"{100 * loss:.1f}",
            }
            for name, value in rows.items()
        ]


def over_severities(values: Mapping[str, float], prefix: str = "") -> dict[str, float]:
    """The mean over the severities of each corruption; nan if any of them is nan.

    Args:
        values: figures by ``corruption/severity``, or by a name without ``/``, such as ``clean``.
        prefix: start of the names that count; it is left out.

    >>> over_severities({"ece/clean": 0.875, "ece/fog/1": 0.75, "ece/fog/3": 0.25, "nll/clean": 2.0}, "ece/")
    {'clean': 0.875, 'fog': 0.5}
    """
    import numpy as np  # not needed by commands that only read a config

    severities: dict[str, list[float]] = {}
    for name, value in values.items():
        if name.startswith(prefix):
            key = name.removeprefix(prefix)
            severities.setdefault(key.rpartition("/")[0] or key, []).append(value)
    return {name: float(np.mean(found)) for name, found in severities.items()}


def relative_loss(clean: float, value: float, better: Literal["higher", "lower"]) -> float:
    """The share of a clean figure that is lost; nan if the clean figure is zero.

    >>> relative_loss(0.8, 0.6, "higher"), relative_loss(2.0, 3.0, "lower")
    (0.25000000000000006, 0.5)
    """
    if clean == 0:
        return float("nan")
    return (clean - value) / clean if better == "higher" else (value - clean) / clean
