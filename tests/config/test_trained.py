"""What a checkpoint's config names is built only if Sextant has a schema for it, wherever it stands."""

import pytest

from sextant.composing.compose import compose, to_plain
from sextant.config.trained import trained_config
from sextant.errors import UserError

PAYLOAD = {"_target_": "os.mkdir", "path": "executed"}


@pytest.mark.parametrize(
    ("overrides", "group", "key", "value"),
    [
        (["task=calibration"], "sampling", "_target_", "os.mkdir"),
        (["task=calibration"], "sampling", "tilt", PAYLOAD),
        (["task=calibration"], "sampling", "roll", [PAYLOAD]),
        (["task=calibration"], "dataset", "conditions", [PAYLOAD]),
        (["task=place_recognition"], "dataset", "conditions", [{"deep": [PAYLOAD]}]),
        ([], "backbone", "_target_", "os.mkdir"),
    ],
)
def test_an_import_path_is_found_wherever_it_hides(overrides, group, key, value):
    raw = to_plain(compose(overrides))
    task = raw["task"]["name"]
    assert trained_config(raw, task).custom_targets() == []
    raw[group][key] = value
    with pytest.raises(UserError, match=r"import paths outside Sextant: os\.mkdir"):
        trained_config(raw, task)
    assert trained_config(raw, task, trust=True).custom_targets() == ["os.mkdir"]
