"""A published benchmark set as a suite, with its protocol."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.contract import Images, Indices
from sextant.corruptions.corruption import Corruption
from sextant.corruptions.pixels import eight_bit
from sextant.corruptions.sets import CIFAR10_C, CIFAR100_C, IMAGENET_C, MNIST_C
from sextant.corruptions.sets.benchmark_set import BenchmarkSet
from sextant.corruptions.suite import Condition, CorruptionSuite, Protocol
from sextant.errors import ArgumentError
from sextant.ranges import Seed, checked

SETS = {benchmark.key: benchmark for benchmark in (CIFAR10_C, CIFAR100_C, MNIST_C, IMAGENET_C)}
Names = str | Sequence[str] | None
Chosen = dict[str, BenchmarkCorruption[Any, Any]]


def benchmark_set(key: str) -> BenchmarkSet:
    """The set ``cifar10_c``, ``cifar100_c``, ``mnist_c`` or ``imagenet_c``.

    >>> benchmark_set("mnist_c").build(["fog"]).keys()
    dict_keys(['fog'])

    Raises:
        UserError: there is no such set.
    """
    if key not in SETS:
        raise ArgumentError(f"set={key} is not known", f"There are: {', '.join(SETS)}.")
    return SETS[key]


def cifar10_c(names: Names = None, severities: Sequence[int] | None = None, mode: Mode = "faithful") -> Chosen:
    """Corruptions of CIFAR-10-C by name; see :meth:`.BenchmarkSet.build`.

    >>> import torch
    >>> images = torch.rand(2, 3, 32, 32)
    >>> cifar10_c()["fog"](images, level=3, indices=torch.arange(2), seed=0).shape
    torch.Size([2, 3, 32, 32])
    """
    return CIFAR10_C.build(names, severities, mode)


def mnist_c(names: Names = None, severities: Sequence[int] | None = None, mode: Mode = "faithful") -> Chosen:
    """Corruptions of MNIST-C by name, by default at their published severity; see :meth:`.BenchmarkSet.build`.

    >>> len(mnist_c())
    15
    """
    return MNIST_C.build(names, severities, mode)


def imagenet_c(names: Names = None, severities: Sequence[int] | None = None, mode: Mode = "faithful") -> Chosen:
    """Corruptions of ImageNet-C by name; see :meth:`.BenchmarkSet.build`.

    >>> list(imagenet_c(["fog", "frost"]))
    ['frost', 'fog']
    """
    return IMAGENET_C.build(names, severities, mode)


class BenchmarkSuite(CorruptionSuite):
    """The conditions of a published set, with images as its files hold them.

    >>> suite = BenchmarkSuite("cifar10_c", ["fog", "contrast"], severities=[1, 5])
    >>> [condition.key for condition in suite.conditions()]
    ['clean', 'fog/1', 'fog/5', 'contrast/1', 'contrast/5']

    With others beside the set:

    >>> from sextant.corruptions import GaussianNoise
    >>> suite = BenchmarkSuite("cifar10_c", ["fog"], [3], beside={"gaussian": GaussianNoise([0.1], clip=False)})
    >>> [condition.key for condition in suite.conditions()], list(suite.protocol.severities)
    (['clean', 'fog/3', 'gaussian/0.1'], ['fog'])

    Args:
        set: ``cifar10_c``, ``cifar100_c``, ``mnist_c`` or ``imagenet_c``.
        names: corruptions to test: all (``None``), a group (``benchmark15``, ``extra4``), or a list of names.
        severities: some of 1 to 5; ``None`` for the published ones.
        mode: ``faithful`` to the authors' code, errors included, or ``corrected``.
        quantise: round corrupted images to 8 bits; see :mod:`.eight_bit`.
        seed: seed of all random draws.
        beside: further corruptions by name, outside the set: not rounded, and in none of its means.

    Raises:
        UserError: a set, name, severity or mode does not exist, or ``beside`` has a name of the set.
    """

    protocol: Protocol

    @checked
    def __init__(
        self,
        set: Literal["cifar10_c", "cifar100_c", "mnist_c", "imagenet_c"] = "cifar10_c",
        names: Names = None,
        severities: Sequence[int] | None = None,
        mode: Mode = "faithful",
        quantise: bool = True,
        seed: Seed = 0,
        beside: Mapping[str, Corruption[Any]] | None = None,
    ):
        chosen = benchmark_set(set)
        of_set, beside = chosen.build(names, severities, mode), dict(beside or {})
        if taken := [name for name in beside if name in chosen.families]:
            raise ArgumentError(f"beside={','.join(taken)}: {chosen.title} has that name", "Choose another.")
        super().__init__({**of_set, **beside}, seed)
        self.mode = mode
        self.quantise = quantise
        rounding = {"faithful": "8 bits, fraction dropped", "corrected": "8 bits, to the nearest"}[mode]
        self.protocol = Protocol(
            set=chosen.key,
            title=chosen.title,
            severities={name: tuple(c.levels) for name, c in of_set.items()},
            mode=mode,
            rounding=rounding if quantise else "none",
            baseline=chosen.baseline,
            image_size=chosen.image_size,
            seed=seed,
        )

    def corrupt(self, images: Images, indices: Indices, condition: Condition) -> Images:
        """``images``, in [0, 1] and at positions ``indices`` of their dataset, under ``condition``."""
        corrupted = super().corrupt(images, indices, condition)
        if condition.corruption not in self.protocol.severities or not self.quantise:
            return corrupted
        return eight_bit(corrupted, self.mode)
