import subprocess
import sys

import pytest

from sextant.localization import observation
from sextant.localization.observation import MODELS, ObservationModel, observation_model


@pytest.mark.parametrize("name", MODELS)
def test_models_are_found_by_name(name):
    model = observation_model(name)
    assert model.__name__ == name
    assert issubclass(model, ObservationModel)
    assert getattr(observation, name) is model


def test_a_name_that_is_none_is_refused():
    with pytest.raises(ValueError, match=r"made_up.*ExactGP"):
        observation_model("made_up")
    with pytest.raises(AttributeError, match="made_up"):
        _ = observation.made_up


def test_nothing_slow_is_imported_before_a_model_is_asked_for():
    code = "import sys, sextant.localization.observation; print(any(m in sys.modules for m in ('numba', 'gpytorch')))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "False"
