"""Metrics of runs, by their names in reports."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from jaxtyping import Float
from numpy import ndarray

from sextant.evaluation import mean_interval, share_interval

#: limits of a protocol, part of the names of metrics that depend on them: ``_0.5m_10deg_10f``
_LIMITS = r"(?:_[\d.]+(?:m|frames)(?:_[\d.]+deg)?_\d+f)?"


#: parts of the names of metrics that are shares, in [0, 1]
SHARES = re.compile(
    r"accuracy|recall|precision|success|tracking|recovered|converged|lost|coverage|share|within|probability|chance"
    r"|R_at_\d|test/error(?:/|$)|(?:\b|_)au[cr]"
)


def seeds_interval(name: str, values: Float[ndarray, "seeds"]) -> tuple[float, float]:
    """The 95 % interval of a metric's mean over seeds; nan for fewer than two seeds.

    A share, by its name and values, gets Korn and Graubard's interval, which stays within [0, 1]: Student's for two
    accuracies of 0.70 and 0.84 would be [-0.12, 1.66]. If all seeds agree on a share, it is nan.

    Args:
        name: name in ``metrics.json``.
        values: one per seed.

    Example:
        >>> import numpy as np
        >>> low, high = seeds_interval("test/accuracy/clean", np.array([0.70, 0.84, 0.77]))
        >>> f"{low:.2f} to {high:.2f}"
        '0.55 to 0.92'
    """
    if SHARES.search(name) and ((values >= 0) & (values <= 1)).all():
        return share_interval(values)
    return mean_interval(values)


@dataclass(frozen=True)
class Metric:
    """A metric as a column of a report.

    Attributes:
        name: name of the metric in ``metrics.json``, without ``test/``, the limits of a protocol, and the condition. A
            name that contains a slash is used unchanged.
        title: title of the column.
        meaning: explanation for the reader, if the title is not enough.
        scale: factor by which values are multiplied.
    """

    name: str
    title: str
    meaning: str = ""
    scale: float = 1.0

    @property
    def is_share(self) -> bool:
        """Whether its values are shares, shown in per cent."""
        return self.scale == 100

    def values(self, metrics: Mapping[str, float], conditions: Sequence[str]) -> dict[str, float]:
        """The metric's values in a run, by condition; ``""`` is the key of the value for all conditions together.

        Args:
            metrics: metrics of the run.
            conditions: conditions of the report; names of metrics have slashes and underscores for their commas and
                spaces.
        """
        spelt = {condition.replace(", ", "/").replace(" ", "_"): condition for condition in conditions}
        start = re.escape(self.name) if "/" in self.name else f"test/{re.escape(self.name)}"
        wanted = re.compile(f"{start}{_LIMITS}(?:/(?P<condition>.+))?")
        found = {}
        for key, value in metrics.items():
            if matched := wanted.fullmatch(key):
                condition = matched["condition"] or ""
                found[spelt.get(condition, condition)] = self.scale * value
        return found


_KNOWN = (
    Metric("success", "success, %", scale=100),
    Metric("frames_to_converge_median", "frames to converge", "median of the runs along drives that converged"),
    Metric("recovered", "recovered, %", "of the runs that were carried away", scale=100),
    Metric("frames_to_recover_median", "frames to recover", "median of the runs that recovered"),
    Metric("tracking", "tracking, %", "share of the frames within the limits, from convergence on", scale=100),
    Metric("position_error_median", "position error", "median from convergence on, in the unit of the map"),
    Metric("heading_error_deg_median", "heading error, deg", "likewise"),
    Metric("error_of_all_frames_median", "error of all frames", "median, before convergence too"),
    Metric("pose_nll", "NLL of the pose", "nats, of the true pose under the particles from convergence on"),
    Metric("nees_median", "NEES, median", "of a calibrated posterior 2.37 in the plane, 0.45 along a railway"),
    Metric("coverage_95", "95 % region holds, %", "share of the steps whose region holds the true pose", scale=100),
    Metric("ess", "ESS", "effective particles before resampling, mean"),
    Metric(
        "descriptor_nll",
        "NLL of descriptors",
        "nats a number of the test drives' descriptors at their true poses, under the fitted appearance noise and "
        "without tempering",
    ),
    Metric("us_per_particle", "µs a particle", "of weighing 1,000 of them"),
    Metric("ms_per_image", "ms an image", "that it costs once, whatever the number of particles"),
    Metric("ms_per_step_of_all_runs", "ms a step", "of a filter of all runs along a drive at once"),
    Metric("fit_map_s", "fit, s", "of the observation model to the map"),
    Metric("model_mb", "model, MB", "beside the map's descriptors"),
    Metric(
        "peak_memory_mb",
        "peak memory, MB",
        "resident, training included; a worker of a sweep holds what runs before it left",
    ),
)
KNOWN = {metric.name: metric for metric in _KNOWN}


def metric_of(name: str) -> Metric:
    """The metric of that name; an unknown metric has its name as its title."""
    return KNOWN.get(name) or Metric(name, name)
