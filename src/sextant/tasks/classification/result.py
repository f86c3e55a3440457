"""The test result of a classifier."""

from dataclasses import dataclass

from jaxtyping import Int64, UInt8
from numpy import ndarray


@dataclass(frozen=True)
class ClassificationResult:
    """Predictions on the test split under every condition.

    Attributes:
        labels: true classes, in the order of the split.
        indices: positions in the split.
        predictions: predicted classes by condition key.
    """

    labels: Int64[ndarray, "n"]
    indices: Int64[ndarray, "n"]
    predictions: dict[str, UInt8[ndarray, "n"] | Int64[ndarray, "n"]]

    def accuracy(self) -> dict[str, float]:
        """Share of correct predictions by condition key."""
        return {key: float((chosen == self.labels).mean()) for key, chosen in self.predictions.items()}
