"""Baselines for normalising corruption errors: two published AlexNets, a model of one's own, or a JSON file."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sextant.atomic_files import write_json
from sextant.errors import UserError
from sextant.evaluation.corruption_error import CorruptionErrors


@dataclass(frozen=True)
class CorruptionBaseline:
    """Reference errors that others are compared with, as shares in [0, 1].

    Attributes:
        name: its name in reports.
        source: where its errors come from.
        clean: error on clean images.
        errors: by corruption: one per severity, or only their mean, as printed in papers.
    """

    name: str
    source: str
    clean: float
    errors: Mapping[str, tuple[float, ...]]

    @classmethod
    def of_model(cls, name: str, source: str, errors: CorruptionErrors) -> "CorruptionBaseline":
        """Make a tested model the baseline, so that its own CE and relative CE are 1.

        >>> from sextant.evaluation.corruption_score import corruption_score
        >>> errors = CorruptionErrors(0.1, {"fog": (0.2, 0.4)})
        >>> corruption_score(errors, CorruptionBaseline.of_model("mine", "run 12", errors)).mean_ce
        1.0
        """
        return cls(name, source, errors.clean, dict(errors.severities))


#: AlexNet of the push-pull paper on CIFAR-10-C, 19 corruptions
ALEXNET_CIFAR10_C = CorruptionBaseline(
    "AlexNet on CIFAR-10-C",
    "Strisciuglio et al., Neural Computing and Applications 32, 2020, tables 2 and 3",
    clean=0.1387,
    errors={
        "gaussian_noise": (0.3844,),
        "shot_noise": (0.3182,),
        "impulse_noise": (0.4613,),
        "defocus_blur": (0.2353,),
        "glass_blur": (0.4097,),
        "motion_blur": (0.2932,),
        "zoom_blur": (0.2689,),
        "snow": (0.2694,),
        "frost": (0.2826,),
        "fog": (0.3031,),
        "brightness": (0.1784,),
        "contrast": (0.4677,),
        "elastic_transform": (0.2225,),
        "pixelate": (0.1836,),
        "jpeg_compression": (0.1848,),
        "speckle_noise": (0.3126,),
        "gaussian_blur": (0.2778,),
        "spatter": (0.2519,),
        "saturate": (0.2215,),
    },
)
#: AlexNet of the benchmark's authors on ImageNet-C, its 15 corruptions
ALEXNET_IMAGENET_C = CorruptionBaseline(
    "AlexNet on ImageNet-C",
    "Hendrycks & Dietterich, ICLR 2019; digits as in https://github.com/hendrycks/robustness",
    clean=0.435,
    errors={
        "gaussian_noise": (0.886428,),
        "shot_noise": (0.894468,),
        "impulse_noise": (0.922640,),
        "defocus_blur": (0.819880,),
        "glass_blur": (0.826268,),
        "motion_blur": (0.785948,),
        "zoom_blur": (0.798360,),
        "snow": (0.866816,),
        "frost": (0.826572,),
        "fog": (0.819324,),
        "brightness": (0.564592,),
        "contrast": (0.853204,),
        "elastic_transform": (0.646056,),
        "pixelate": (0.717840,),
        "jpeg_compression": (0.606500,),
    },
)

EXAMPLE = '{"name": "my AlexNet", "source": "run 12", "clean": 0.14, "errors": {"fog": [0.2, 0.25, 0.3, 0.35, 0.5]}}'


def write_baseline(path: Path, baseline: CorruptionBaseline) -> None:
    """Write ``baseline`` as the JSON that :func:`read_baseline` reads.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     write_baseline(Path(folder, "a.json"), ALEXNET_CIFAR10_C)
    ...     read_baseline(Path(folder, "a.json")) == ALEXNET_CIFAR10_C
    True
    """
    content = {
        "name": baseline.name,
        "source": baseline.source,
        "clean": baseline.clean,
        "errors": {name: list(errors) for name, errors in baseline.errors.items()},
    }
    write_json(path, content)


def read_baseline(path: Path) -> CorruptionBaseline:
    """Read a baseline from JSON with ``name``, ``source``, ``clean`` and ``errors`` (by corruption, a list or a mean).

    Raises:
        UserError: the file cannot be read, or a value is missing or not a share in [0, 1].

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     _ = (file := Path(folder, "a.json")).write_text(EXAMPLE)
    ...     read_baseline(file).errors
    {'fog': (0.2, 0.25, 0.3, 0.35, 0.5)}
    """
    fix = f"Write it like this:\n{EXAMPLE}"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"the baseline {path} cannot be read: {error.strerror}", fix) from error
    except ValueError as error:
        raise UserError(f"the baseline {path} is not JSON: {error}", fix) from error
    if not isinstance(content, dict) or not isinstance(content.get("errors"), dict) or not content["errors"]:
        raise UserError(f"the baseline {path} has no errors by corruption", fix)
    errors = {name: _shares(path, f"errors.{name}", value) for name, value in content["errors"].items()}
    clean = _share(path, "clean", content.get("clean"))
    return CorruptionBaseline(str(content.get("name", path.stem)), str(content.get("source", path.name)), clean, errors)


def _shares(path: Path, key: str, value: Any) -> tuple[float, ...]:
    return tuple(_share(path, key, number) for number in (value if isinstance(value, list) and value else [value]))


def _share(path: Path, key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1:
        raise UserError(
            f"{key} in the baseline {path} is {json.dumps(value)}, but errors are shares in [0, 1]",
            "Divide percentages by 100.",
        )
    return float(value)
