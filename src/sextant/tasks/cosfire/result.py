"""What each method answered on the test images."""

from dataclasses import dataclass, field

from jaxtyping import Bool, Int64
from numpy import ndarray

from sextant.tasks.cosfire.methods import Method


@dataclass
class RecognitionResult:
    """Answers on the test images.

    Attributes:
        labels: true classes.
        answers: by method.
        conditions: which images are of it, by its name; empty where all are of one.
    """

    labels: Int64[ndarray, "n"]
    answers: dict[Method, Int64[ndarray, "n"]] = field(default_factory=dict)
    conditions: dict[str, Bool[ndarray, "n"]] = field(default_factory=dict)

    def accuracy(self) -> dict[Method, float]:
        """Share of right answers by method."""
        return {method: float((found == self.labels).mean()) for method, found in self.answers.items()}

    def accuracy_under(self, condition: str) -> dict[Method, float]:
        """The same for the images of one condition."""
        rows = self.conditions[condition]
        return {method: float((found == self.labels)[rows].mean()) for method, found in self.answers.items()}

    def arrays(self) -> dict[str, ndarray]:
        """Labels, answers and conditions, as a run stores them."""
        answers = {f"answer/{method}": found for method, found in self.answers.items()}
        conditions = {f"condition/{name}": found for name, found in self.conditions.items()}
        return {"labels": self.labels, **answers, **conditions}
