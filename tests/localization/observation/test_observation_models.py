import pytest

from sextant.chapters.localization.config import Observation
from sextant.config.schema.parts import parts_of
from sextant.localization import observation
from sextant.localization.observation import ObservationModel, observation_model

MODELS = [part.__name__ for part in parts_of(Observation) if part.__name__ not in ("LikelihoodField", "BeamModel")]


@pytest.mark.parametrize("name", MODELS)
def test_models_are_found_by_name(name):
    model = observation_model(name)
    assert model.__name__ == name
    assert issubclass(model, ObservationModel)
    assert getattr(observation, name) is model


@pytest.mark.parametrize("name", ["made_up", "MadeUp", "os.system", "_Tiles", "model", "Model", "Evidence", ""])
def test_a_name_that_is_none_is_refused(name):
    with pytest.raises(ValueError, match=rf"'{name}'.*ExactGP"):
        observation_model(name)


def test_only_models_are_found_as_attributes():
    with pytest.raises(AttributeError, match="made_up"):
        _ = observation.made_up
