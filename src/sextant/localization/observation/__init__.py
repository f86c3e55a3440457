"""What the image at any pose will look like, as Gaussians of its descriptor: exact, local, sparse and rival models."""

from importlib import import_module

from sextant.localization.observation.evidence import Evidence
from sextant.localization.observation.model import ObservationModel
from sextant.localization.observation.prediction import Prediction, Residuals

_HERE = "sextant.localization.observation"
#: Modules of the models by class name; one is imported when it is asked for, as some of them are slow to import.
MODELS = {
    "ExactGP": f"{_HERE}.exact_gp",
    "LocalGP": f"{_HERE}.local_gp",
    "CachedLocalGP": f"{_HERE}.cached_local_gp",
    "SGPR": f"{_HERE}.sgpr",
    "SVGP": f"{_HERE}.svgp",
    "SKI": f"{_HERE}.ski",
    "RandomFeatures": f"{_HERE}.random_features",
    "KernelSum": f"{_HERE}.kernel_sum",
}


def observation_model(name: str) -> type[ObservationModel]:
    """The class of that name.

    Raises:
        ValueError: there is none.
    """
    if name not in MODELS:
        raise ValueError(f"observation model {name!r} must be one of {', '.join(MODELS)}")
    found: type[ObservationModel] = getattr(import_module(MODELS[name]), name)
    return found


def __getattr__(name: str) -> type[ObservationModel]:
    """The models, imported when they are asked for."""
    if name in MODELS:
        return observation_model(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = ["MODELS", "Evidence", "ObservationModel", "Prediction", "Residuals", "observation_model"]
