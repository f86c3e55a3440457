"""Models in MLflow's registry, which MLflow can serve."""

import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from sextant.errors import DISTRIBUTION
from sextant.tracking.store import Store

if TYPE_CHECKING:
    from mlflow.models import ModelSignature

#: names of the artifact with a model's checkpoint, and of the column of images
CHECKPOINT, IMAGE = "checkpoint", "image"


class Answers(Protocol):
    """A predictor that a served model calls."""

    def predict(self, photos: Sequence[Path]) -> list[dict[str, Any]]:
        """One row per photo."""


def serve(load: Callable[[Path], Answers]) -> None:
    """Define the model that MLflow serves; called by the code file stored with a model.

    The model takes a table with a column ``image``, the bytes of image files of any kind and size.

    Args:
        load: makes the predictor from the path of a checkpoint.
    """
    from mlflow.models import set_model
    from mlflow.pyfunc.model import PythonModel

    class Served(PythonModel):
        def load_context(self, context: Any) -> None:
            self.answers = load(Path(context.artifacts[CHECKPOINT]))

        # without types, from which MLflow would infer its own signature
        def predict(self, context, model_input, params=None):  # type: ignore[no-untyped-def]
            return answered(self.answers, list(model_input[IMAGE]))

    set_model(Served())


def answered(model: Answers, images: Sequence[bytes]) -> list[dict[str, Any]]:
    """Rows for image files that are given as bytes."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        paths = [Path(folder) / f"image {number}" for number in range(len(images))]
        for path, content in zip(paths, images, strict=True):
            path.write_bytes(content)
        return [{name: _without(folder, value) for name, value in row.items()} for row in model.predict(paths)]


def _without(folder: str, value: Any) -> Any:
    """A text without the temporary folder of the images; other values unchanged."""
    return value.replace(f"{folder}/", "") if isinstance(value, str) else value


@dataclass(frozen=True)
class Registration:
    """A model to be registered.

    Attributes:
        name: name of the model in the registry.
        code: file that calls :func:`serve`; it is stored with the model, and nothing is pickled.
        checkpoint: checkpoint of the model.
        card: model card.
        experiment: experiment that shows the model.
        run_id: MLflow run of the model, if the store has it.
    """

    name: str
    code: Path
    checkpoint: Path
    card: Path
    experiment: str
    run_id: str | None


def register_model(store: Store, found: Registration, example: bytes, answer: Mapping[str, Any]) -> int:
    """Log a model with its signature and an example, and make it the newest version of its name.

    Args:
        store: store whose registry is used.
        found: the model.
        example: bytes of an image file.
        answer: the model's prediction for the example.

    Returns:
        The version number.
    """
    import mlflow
    import pandas as pd
    from mlflow.models import Model

    import sextant

    with _at(store, found.experiment), _source_alone(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MLflow asks for type hints, from which it would infer another signature
        info = Model.log(
            artifact_path=None,
            name=found.name.replace(".", "_"),  # of what is logged, which may have no dots; the registry's name may
            flavor=mlflow.pyfunc,
            run_id=found.run_id,
            registered_model_name=found.name,
            python_model=str(found.code),
            artifacts={CHECKPOINT: str(found.checkpoint), found.card.stem: str(found.card)},
            signature=_signature(answer),
            input_example=pd.DataFrame({IMAGE: [example]}),
            pip_requirements=[f"{DISTRIBUTION}=={sextant.__version__}"],
        )
    version = int(info.registered_model_version)
    store.client.update_model_version(found.name, str(version), found.card.read_text("utf-8"))
    return version


def _signature(row: Mapping[str, Any]) -> "ModelSignature":
    """The signature of a model that returns rows like this one."""
    from mlflow.models import ModelSignature
    from mlflow.types import ColSpec, DataType, Schema
    from mlflow.types.schema import Array

    kinds: dict[type, Any] = {list: Array(DataType.double), float: DataType.double, str: DataType.string}
    answers: list[Any] = [ColSpec(kinds[type(value)], name, required=False) for name, value in row.items()]
    return ModelSignature(Schema([ColSpec(DataType.binary, IMAGE)]), Schema(answers))


@contextmanager
def _source_alone() -> Iterator[None]:
    """Write no bytecode while MLflow imports the code from the model's folder, so that no compiled copy is left."""
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.dont_write_bytecode = before


@contextmanager
def _at(store: Store, experiment: str) -> Iterator[None]:
    """Make MLflow's global functions use this store and experiment while the context is open."""
    import mlflow
    from mlflow.tracking import fluent

    before = os.environ.get("MLFLOW_TRACKING_URI")  # MLflow keeps its setting here
    experiment_before = fluent._active_experiment_id, os.environ.get("MLFLOW_EXPERIMENT_ID")
    mlflow.set_tracking_uri(store.uri)  # the registry follows
    mlflow.set_experiment(experiment_id=store.experiment_id(experiment))
    try:
        yield
    finally:
        mlflow.set_tracking_uri(before)  # type: ignore[arg-type]  # None forgets it
        fluent._active_experiment_id, number = experiment_before
        os.environ.pop("MLFLOW_EXPERIMENT_ID", None)
        os.environ |= {} if number is None else {"MLFLOW_EXPERIMENT_ID": number}
