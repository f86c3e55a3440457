"""The test result of a classifier."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from jaxtyping import Int64, UInt8
from numpy import ndarray

from sextant.evaluation.confidence import Confidence, trust


@dataclass(frozen=True)
class ClassificationResult:
    """Predictions on the test split under every condition.

    Attributes:
        labels: true classes, in the order of the split.
        indices: positions in the split.
        predictions: predicted classes by condition key.
        confidences: the network's confidence in its predictions, by condition key.
    """

    labels: Int64[ndarray, "n"]
    indices: Int64[ndarray, "n"]
    predictions: dict[str, UInt8[ndarray, "n"] | Int64[ndarray, "n"]]
    confidences: Mapping[str, Confidence] = field(default_factory=dict)

    def accuracy(self) -> dict[str, float]:
        """Share of correct predictions by condition key."""
        return {key: float((chosen == self.labels).mean()) for key, chosen in self.predictions.items()}

    def trust(self) -> dict[str, float]:
        """Metrics ``test/ece/<condition>`` and ``test/nll/<condition>``; see :func:`.trust`."""
        return {
            name: value
            for key, told in self.confidences.items()
            for name, value in trust(key, told.predicted, told.nll, self.predictions[key] == self.labels).items()
        }

    def arrays(self) -> dict[str, ndarray]:
        """Labels, predictions by condition, and confidences under the prefixes ``confidence/`` and ``nll/``."""
        told = {f"confidence/{key}": found.predicted for key, found in self.confidences.items()}
        told |= {f"nll/{key}": found.nll for key, found in self.confidences.items()}
        return {"labels": self.labels, **self.predictions, **told}
