"""The definitions that results rest on, fixed here before any result exists."""

#: A claim needs this many seeds; fewer is labelled exploratory. With 5 a sign test cannot go below p = 0.0625.
SEEDS_FOR_A_CLAIM = 8

#: A classification run has converged if its validation accuracy after training is at least this far from chance to 1.
#: It is judged on the validation split alone. Runs below are reported as diverged, counted, and never dropped silently.
CONVERGED_ABOVE_CHANCE = 0.5


def classification_converged(validation_accuracy: float, num_classes: int) -> bool:
    """Whether a trained classifier learnt at all: ``accuracy >= chance + 0.5 (1 - chance)``, chance being 1/K."""
    chance = 1 / num_classes
    return validation_accuracy >= chance + CONVERGED_ABOVE_CHANCE * (1 - chance)


#: A calibration run has converged if its median bearing error on the validation split is at most this share of that of
#: the constant camera in the middle of the training distribution.
CONVERGED_BELOW_CONSTANT = 0.8


def calibration_converged(bearing_deg: float, constant_bearing_deg: float) -> bool:
    """Whether a trained calibration network learnt at all: ``error <= 0.8 x`` that of the constant camera."""
    return bearing_deg <= CONVERGED_BELOW_CONSTANT * constant_bearing_deg


#: A run of place recognition has converged if its recall@1 on the validation split is at least this many times chance.
CONVERGED_TIMES_CHANCE = 3.0


def places_converged(recall_at_1: float, chance: float) -> bool:
    """Whether a trained descriptor learnt at all: ``recall@1 >= min(3 chance, (1 + chance) / 2)``."""
    return recall_at_1 >= min(CONVERGED_TIMES_CHANCE * chance, (1 + chance) / 2)
