"""CIFAR-10-P as a suite: a condition is a frame, and the measure is how often the predicted class changes."""

from collections.abc import Sequence

from sextant.corruptions.contract import Images, Indices
from sextant.corruptions.pixels import eight_bit
from sextant.corruptions.suite import Condition, CorruptionSuite
from sextant.errors import ArgumentError
from sextant.ranges import Seed, checked


class PerturbationSuite(CorruptionSuite):
    """The frames of the perturbation sequences of CIFAR-10-P, in 8 bits as its files hold them.

    >>> len(PerturbationSuite(["rotate"]).sequence("rotate"))
    31

    Args:
        names: names of the perturbations; ``None`` for all ten.
        seed: seed of all random draws.

    Raises:
        ArgumentError: ``names`` is empty, or holds one that is not a perturbation.
    """

    @checked
    def __init__(self, names: Sequence[str] | None = None, seed: Seed = 0):
        from sextant.corruptions.perturbations import cifar10_p  # machine code, loaded only when it is needed

        there = cifar10_p()
        if names is not None and (not names or not set(names) <= set(there)):
            given = "[" + ", ".join(names) + "]"
            raise ArgumentError(f"names={given} must list some perturbations", f"There are: {', '.join(there)}.")
        super().__init__({name: made for name, made in there.items() if names is None or name in names}, seed)

    def corrupt(self, images: Images, indices: Indices, condition: Condition) -> Images:
        """The frame ``condition`` of ``images``, which are in [0, 1] and at positions ``indices`` of their dataset."""
        frame = super().corrupt(images, indices, condition)
        return frame if condition.corruption is None else eight_bit(frame, "faithful")

    def sequence(self, name: str) -> list[Condition]:
        """The frames of a perturbation in order; those with noise start with the clean image.

        Raises:
            ArgumentError: the suite has no such perturbation.
        """
        frames = [Condition(name, level) for level in self._named(name).levels]
        return [Condition(), *frames] if name.endswith("noise") else frames
