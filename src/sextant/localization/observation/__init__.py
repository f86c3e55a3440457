"""Observation models: Gaussians of the image descriptor at any pose. Exact, local, sparse and baseline models."""

import re
from importlib import import_module
from importlib.util import find_spec

from sextant.localization.observation.evidence import Evidence
from sextant.localization.observation.model import ObservationModel, Prediction, Residuals


def observation_model(name: str) -> type[ObservationModel]:
    """A class of this package by its name, such as ``LocalGP`` of ``local_gp``; imported on demand, as some are slow.

    Raises:
        ValueError: there is no such class.

    >>> observation_model("LocalGP").__module__
    'sextant.localization.observation.local_gp'
    """
    module = f"{__name__}.{re.sub('(?<=[a-z])(?=[A-Z])', '_', name).lower()}"
    there = re.fullmatch("[A-Z][A-Za-z]*", name) and find_spec(module) is not None
    found = getattr(import_module(module), name, None) if there else None
    if not (isinstance(found, type) and issubclass(found, ObservationModel)):
        raise ValueError(f"observation model {name!r}: {__name__} has no such class; an example is ExactGP")
    return found


def __getattr__(name: str) -> type[ObservationModel]:
    """The models, imported on demand."""
    try:
        return observation_model(name)
    except ValueError:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None


__all__ = ["Evidence", "ObservationModel", "Prediction", "Residuals", "observation_model"]
