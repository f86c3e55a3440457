import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from tiny_calibration import tiny_module, tiny_spec

from sextant.chapters.calibration.network import trained_camera_network
from sextant.errors import UserError
from sextant.kit.trained import read_trained
from sextant.runs.checkpoint import SCHEMA_VERSION
from sextant.runs.resolve import resolve_run
from sextant.zoo import model_file, names, read_card, read_model, write_model


@pytest.fixture(scope="module")
def module_and_config():
    return tiny_module()


@pytest.fixture
def shelf(tmp_path, module_and_config):
    """A folder of one model."""
    module, raw = module_and_config
    model = {"schema_version": SCHEMA_VERSION, "config": raw, "spec": tiny_spec(), "task": "calibration"}
    write_model("tiny", model, module.state_dict(), {"licence": "MIT"}, tmp_path)
    return tmp_path


def test_a_model_is_found_by_its_name_and_opens_as_a_checkpoint_does(shelf, module_and_config):
    module, _ = module_and_config
    assert names(shelf) == ["tiny"]
    path = model_file("zoo:tiny", shelf)
    network = trained_camera_network(read_trained(path), path)
    images, aspect = torch.randint(0, 256, (4, 3, 18, 24), dtype=torch.uint8), torch.full((4,), 4 / 3)
    for found, expected in zip(*(each.predict(images, aspect).parameters for each in (network, module)), strict=True):
        torch.testing.assert_close(found, expected, atol=2e-3, rtol=0)


def test_parameters_are_kept_in_half_precision_and_read_in_single(shelf):
    path = model_file("zoo:tiny", shelf)
    kinds = {value.dtype for name, value in load_file(path).items() if name.endswith("weight") and value.ndim > 1}
    assert kinds == {torch.float16}
    state = read_trained(path)["state_dict"]
    assert all(value.dtype == torch.float32 for value in state.values() if value.is_floating_point())
    assert read_card(path)["licence"] == "MIT"


def test_altered_weights_are_refused(shelf):
    path = model_file("zoo:tiny", shelf)
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(UserError, match="SHA-256 differs from that of its card") as raised:
        read_trained(path)
    assert "pip install" in raised.value.fix


@pytest.mark.parametrize("written", ["", "{}", "[1]", '{"sha256": 3, "model": {}}'])
def test_a_damaged_card_is_named(shelf, written):
    (shelf / "tiny.json").write_text(written)
    with pytest.raises(UserError, match=r"tiny\.json is damaged"):
        read_trained(shelf / "tiny.safetensors")


def test_missing_files_are_named(shelf):
    (shelf / "tiny.safetensors").unlink()
    with pytest.raises(UserError, match="zoo:tiny: its weights are missing"):
        model_file("zoo:tiny", shelf)
    with pytest.raises(UserError, match="zoo:other: no such model") as raised:
        model_file("zoo:other", shelf)
    assert "zoo:tiny" in raised.value.fix
    (shelf / "alone.safetensors").write_bytes(b"")
    with pytest.raises(UserError, match="no card beside it"):
        read_trained(shelf / "alone.safetensors")


def test_a_card_of_another_file_does_not_open_weights(shelf):
    card = json.loads((shelf / "tiny.json").read_text())
    (shelf / "tiny.json").write_text(json.dumps({**card, "sha256": "0" * 64}))
    with pytest.raises(UserError, match="was altered or is damaged"):
        read_trained(shelf / "tiny.safetensors")


def test_a_run_of_the_zoo_is_known_wherever_runs_are(tmp_path):
    with pytest.raises(UserError, match="zoo:nothing: no such model"):
        resolve_run("zoo:nothing", tmp_path)


def test_tensors_that_share_their_memory_and_those_of_double_precision_are_written_as_they_are(tmp_path):
    one = torch.full((2, 2), 1 / 3, dtype=torch.float64)
    model = {"schema_version": SCHEMA_VERSION, "config": {}, "spec": {}, "task": "localization"}
    path = write_model("shared", model, {"a": one, "b": one[:1]}, {"licence": "MIT"}, tmp_path)
    _, weights = read_model(path)
    assert torch.equal(weights["a"], one)
    assert torch.equal(weights["b"], one[:1])


def test_the_page_of_the_models_has_each():
    page = (Path(__file__).parents[2] / "docs" / "models.md").read_text()
    assert [name for name in names() if f"`zoo:{name}`" not in page] == []
