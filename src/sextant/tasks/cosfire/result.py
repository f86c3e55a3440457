"""The predictions of each method on the test images."""

from dataclasses import dataclass, field

from jaxtyping import Bool, Int64
from numpy import ndarray

from sextant.tasks.cosfire.methods import Method


@dataclass
class RecognitionResult:
    """Predictions on the test images.

    Attributes:
        labels: true classes.
        answers: predicted classes by method.
        conditions: by name, which images are of that condition; empty if all are of one.
    """

    labels: Int64[ndarray, "n"]
    answers: dict[Method, Int64[ndarray, "n"]] = field(default_factory=dict)
    conditions: dict[str, Bool[ndarray, "n"]] = field(default_factory=dict)

    def accuracy(self) -> dict[Method, float]:
        """Share of correct predictions by method."""
        return {method: float((found == self.labels).mean()) for method, found in self.answers.items()}

    def accuracy_under(self, condition: str) -> dict[Method, float]:
        """The same for the images of one condition."""
        rows = self.conditions[condition]
        return {method: float((found == self.labels)[rows].mean()) for method, found in self.answers.items()}

    def arrays(self) -> dict[str, ndarray]:
        """Labels, predictions and conditions, as stored by a run."""
        answers = {f"answer/{method}": found for method, found in self.answers.items()}
        conditions = {f"condition/{name}": found for name, found in self.conditions.items()}
        return {"labels": self.labels, **answers, **conditions}
