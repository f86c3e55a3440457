"""Which recognition methods are compared, and how their SVMs are fitted."""

from dataclasses import dataclass, field

from sextant.baselines.linear_svm import SCALINGS, Scaling
from sextant.chapters.cosfire.fine_tuning import FineTuning
from sextant.chapters.cosfire.methods import OF_NETWORK, Method


@dataclass(frozen=True)
class Comparison:
    """The methods compared, and how SVMs are fitted.

    Attributes:
        methods: see :data:`~sextant.chapters.cosfire.methods.METHODS`.
        c_values: values of C, of which tuning images choose one; a single value needs no tuning images.
        scalings: scalings of the features of an SVM, chosen likewise.
        choose_among: number of examples to which SVMs are fitted while values of C are compared.
        network_answers: whether the network was trained for the classes that are tested.
        logarithms: whether SVMs use logarithms of the filters' maxima.
        tiles: per side of the image, for the method ``tiled_svm``.
        fine_tuning: fine-tuning of a copy of the filters, for the methods ``cosfire_tuned`` and ``layer_tuned``; with 0
            epochs these are left out.
    """

    methods: tuple[Method, ...] = ("cosfire_svm", "tiled_svm", "strongest_filter", *OF_NETWORK)
    c_values: tuple[float, ...] = (1.0, 10.0, 100.0)
    scalings: tuple[Scaling, ...] = SCALINGS
    choose_among: int = 1500
    logarithms: bool = False
    tiles: int = 3
    network_answers: bool = True
    fine_tuning: FineTuning = field(default_factory=FineTuning)
