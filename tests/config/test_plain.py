"""A config keeps the values that it was made of."""

from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.config.building import build


def test_a_config_has_its_plain_values_untouched():
    raw = to_plain(compose(["optimizer.momentum=0", "optimizer.nesterov=false"]))
    config = validate(raw)
    assert config.plain == raw
    assert type(config.plain["optimizer"]["momentum"]) is int
    assert type(config.optimizer.momentum) is float
    assert config.model_copy().plain == raw
    assert "plain" not in config.model_dump()
    assert build(config.plain, "backbone", in_channels=1, image_size=(28, 28), num_classes=10) is not None
