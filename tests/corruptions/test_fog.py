import pytest
import torch

from sextant.corruptions import cifar10_c, imagenet_c
from sextant.corruptions.textures import plasma
from sextant.corruptions.weather import Fog

FOG = Fog(((0.2, 3.0), (1.5, 1.75)), "fog", levels=(1, 2))


def test_fog_is_added_and_dimmed_to_the_images_range():
    clean = torch.rand(3, 3, 20, 28) * 0.8
    noise = FOG.draw(2, torch.arange(3), (3, 20, 28), 0)
    assert noise.shape == (3, 32, 32)
    mist = plasma(noise, 1.75)[:, :20, :28].float()
    for i in range(3):
        m = clean[i].max()
        torch.testing.assert_close(FOG.apply(clean, 2, noise)[i], (clean[i] + 1.5 * mist[i]) * m / (m + 1.5))


def test_black_stays_black():
    assert torch.equal(FOG(torch.zeros(2, 1, 8, 8), 1, torch.arange(2), 0), torch.zeros(2, 1, 8, 8))


def test_a_bigger_map_can_be_asked_for_and_never_is_too_small():
    draws = {
        size: Fog(((1, 2),), "fog", map_size=size).draw(1, torch.arange(1), (1, 28, 28), 0) for size in (None, 8, 256)
    }
    assert {size: draw.shape[-1] for size, draw in draws.items()} == {None: 32, 8: 32, 256: 256}


def test_maps_that_do_not_fit_at_once_make_the_same_fog(monkeypatch):
    clean = torch.rand(5, 3, 32, 32)
    together = FOG(clean, 2, torch.arange(5), 0)
    monkeypatch.setattr("sextant.corruptions.weather.MAP_POINTS", 2 * 32 * 32)
    assert torch.equal(FOG(clean, 2, torch.arange(5), 0), together)


@pytest.mark.parametrize("smooth", [False, True])
def test_the_square_error_rises_with_severity_on_cifar(smooth):
    generator = torch.Generator().manual_seed(0)
    noise = torch.rand(64, 32, 32, generator=generator)
    clean = (plasma(noise * 2 - 1, 1.6).float() if smooth else noise**2)[:, None].expand(64, 3, 32, 32)
    assert square_errors(cifar10_c, clean) == sorted(square_errors(cifar10_c, clean))


def test_the_same_fog_does_more_at_each_of_imagenets_severities():
    noise = torch.rand(16, 256, 256, generator=torch.Generator().manual_seed(0)) * 2 - 1
    clean = plasma(noise, 1.6, (224, 224)).float()[:, None]
    fog = imagenet_c(names=["fog"])["fog"]
    same = fog.draw(1, torch.arange(16), (1, 224, 224), 0)
    errors = [(fog.apply(clean, level, same) - clean).square().mean().item() for level in fog.levels]
    assert errors == sorted(errors)


def square_errors(which, clean):
    fog = which(names=["fog"])["fog"]
    indices = torch.arange(len(clean))
    return [(fog(clean, level, indices, 0) - clean).square().mean().item() for level in fog.levels]
