"""The push-pull paper's result files, as its authors published them, and the table that they printed.

``C_details.txt`` has a line a corruption, ``name: e1 e2 e3 e4 e5``, errors as shares; ``C_average.txt`` their means in
per cent; ``P_flipprob.txt``, ``P_top5dist.txt`` and ``P_zipfdist.txt`` a line a perturbation; ``test_clean.txt`` the
output of one or more test runs on clean images.

Two things to know. The paper's clean errors are those of the best epoch *on the test set*, its corruption errors those
of the last epoch. And of the files, those of DenseNet-40-12 and DenseNet-100-24 are from other runs than the table.

Source: https://github.com/nicstrisc/Push-Pull-CNN-layer, folder ``results``, MIT licence.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from sextant.errors import UserError
from sextant.evaluation.corruption_errors import CorruptionErrors

NUMBER = r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?"
DETAILS = re.compile(rf"\s*(\w+):((?:\s+{NUMBER})+)\s*")
LABELLED = re.compile(rf"\s*(?:Distortion|Perturbation):\s*(\w+)\s*\|\s*([^:]+):\s*({NUMBER})\s*")
CLEAN = re.compile(rf"\*\s*Prec@1\s+({NUMBER})")


@dataclass(frozen=True)
class PublishedRow:
    """A row of the paper's table 3 on CIFAR-10 and CIFAR-10-C, all in per cent as printed.

    Attributes:
        clean: error of the best epoch on the test set.
        error: mean over 19 corruptions and five severities.
        mean_ce, mean_relative_ce: relative to the paper's AlexNet.
    """

    clean: float
    error: float
    mean_ce: float
    mean_relative_ce: float


#: table 3; ``-pp`` has push-pull in the first convolution. ResNet-56 is printed as "52"; the error of ResNet-20-PP as
#: 29.83, which tables 2 and 5 and the files contradict: 29.38.
TABLE_3: dict[str, PublishedRow] = {
    "alexnet": PublishedRow(13.87, 29.08, 100, 100),
    "resnet-20": PublishedRow(7.56, 30.29, 104, 169),
    "resnet-20-pp": PublishedRow(8.29, 29.83, 101, 158),
    "resnet-32": PublishedRow(7.29, 30.40, 104, 171),
    "resnet-32-pp": PublishedRow(7.15, 26.63, 92, 145),
    "resnet-44": PublishedRow(6.76, 28.57, 98, 162),
    "resnet-44-pp": PublishedRow(6.87, 26.91, 92, 149),
    "resnet-56": PublishedRow(6.64, 28.64, 97, 161),
    "resnet-56-pp": PublishedRow(7.01, 26.23, 91, 144),
    "densenet-40-12": PublishedRow(6.38, 31.51, 108, 187),
    "densenet-40-12-pp": PublishedRow(7.13, 29.07, 101, 168),
    "densenet-100-12": PublishedRow(4.70, 25.55, 88, 160),
    "densenet-100-12-pp": PublishedRow(5.04, 23.85, 82, 144),
    "densenet-100-24": PublishedRow(3.88, 24.99, 84, 156),
    "densenet-100-24-pp": PublishedRow(4.50, 21.37, 73, 129),
}


def read_corruption_details(path: Path, clean: float) -> CorruptionErrors:
    """Read ``C_details.txt``; ``clean`` is the error on clean images, which the file does not have.

    Raises:
        UserError: the file cannot be read, a line is not of its form, or a value is not a share.
    """
    severities = {}
    for number, line in _lines(path):
        found = DETAILS.fullmatch(line)
        if found is None:
            raise _unexpected(path, number, line, "name: share share ...")
        severities[found[1]] = tuple(float(value) for value in found[2].split())
    try:
        return CorruptionErrors(clean, severities)
    except ValueError as error:
        raise UserError(f"{path}: {error}", "It should be the authors' C_details.txt.") from error


def read_labelled(path: Path) -> dict[str, float]:
    """Read ``C_average.txt`` (per cent), ``P_flipprob.txt``, ``P_top5dist.txt`` or ``P_zipfdist.txt``.

    Raises:
        UserError: the file cannot be read or a line is not of its form.
    """
    values = {}
    for number, line in _lines(path):
        found = LABELLED.fullmatch(line)
        if found is None:
            raise _unexpected(path, number, line, "Perturbation: name | Flip Prob: value")
        values[found[1]] = float(found[3])
    return values


def read_clean_errors(path: Path) -> tuple[float, ...]:
    """Errors on clean images, as shares, of all the test runs that ``test_clean.txt`` holds, the last one last.

    Raises:
        UserError: the file cannot be read or tells no accuracy.
    """
    found = CLEAN.findall("\n".join(line for _, line in _lines(path)))
    if not found:
        raise UserError(f"{path} has no line '* Prec@1 <accuracy>'", "It should be the authors' test_clean.txt.")
    return tuple(1 - float(accuracy) / 100 for accuracy in found)


def _lines(path: Path) -> list[tuple[int, str]]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(
            f"the result file {path} cannot be read: {error}", "Name a file of the authors' results."
        ) from error
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        raise UserError(f"the result file {path} is empty", "Fetch it again from the authors' repository.")
    return lines


def _unexpected(path: Path, number: int, line: str, form: str) -> UserError:
    return UserError(f"line {number} of {path} is {line.strip()[:80]!r}", f"Each line should read '{form}'.")
