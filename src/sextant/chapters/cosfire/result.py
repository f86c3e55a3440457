"""The predictions of each method on the test images."""

from dataclasses import dataclass, field

from jaxtyping import Bool, Int64
from numpy import ndarray

from sextant.chapters.cosfire.methods import Method


@dataclass
class RecognitionResult:
    """Predictions on the test images.

    Attributes:
        labels: true classes.
        answers: predicted classes by method.
        conditions: by name, which images are of that condition; empty if all are of one.
        corrupted: predicted classes by method of the same images under corruptions, by key of the test condition.
    """

    labels: Int64[ndarray, "n"]
    answers: dict[Method, Int64[ndarray, "n"]] = field(default_factory=dict)
    conditions: dict[str, Bool[ndarray, "n"]] = field(default_factory=dict)
    corrupted: dict[str, dict[Method, Int64[ndarray, "n"]]] = field(default_factory=dict)

    def accuracy(self) -> dict[Method, float]:
        """Share of correct predictions by method."""
        return {method: float((found == self.labels).mean()) for method, found in self.answers.items()}

    def accuracy_under(self, condition: str) -> dict[Method, float]:
        """The same for the images of one condition."""
        rows = self.conditions[condition]
        return {method: float((found == self.labels)[rows].mean()) for method, found in self.answers.items()}

    def accuracies(self) -> dict[str, dict[Method, float]]:
        """Accuracy by method under all names: ``""`` of all clean images, ``/<condition>``, and ``/<corruption>``."""
        found = {"": self.accuracy()} | {f"/{name}": self.accuracy_under(name) for name in self.conditions}
        return found | {f"/{key}": RecognitionResult(self.labels, a).accuracy() for key, a in self.corrupted.items()}

    def headline(self, method: Method) -> dict[str, float]:
        """Accuracy of a method by key of the test condition, ``clean`` first."""
        found = self.accuracies()
        return {"clean": found[""][method]} | {key: found[f"/{key}"][method] for key in self.corrupted}

    def arrays(self) -> dict[str, ndarray]:
        """Labels, predictions and conditions, as stored by a run; corrupted ones as ``corrupted/<method>/<key>``."""
        answers = {f"answer/{method}": found for method, found in self.answers.items()}
        conditions = {f"condition/{name}": found for name, found in self.conditions.items()}
        corrupted = {f"corrupted/{m}/{key}": a for key, of in self.corrupted.items() for m, a in of.items()}
        return {"labels": self.labels, **answers, **conditions, **corrupted}
