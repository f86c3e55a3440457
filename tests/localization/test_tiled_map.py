"""A map that was made of a stream equals the one that was made in memory, however often its making was interrupted."""

import json

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room

from sextant.errors import UserError
from sextant.localization import tiled_map
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.cached_local_gp import CachedLocalGP
from sextant.localization.observation.neighbourhoods import Neighbourhoods
from sextant.localization.pose_kernel import PoseKernel
from sextant.localization.saved_map import HEADER, load_map
from sextant.localization.tiled_map import TiledMapBuilder, Tiles, spatial_order

IMAGES, DIMENSION, K, TILE = 500, 12, 8, 64
LIKELIHOOD = Likelihood("student", tempering=0.25, appearance_variance=0.01)
POSES = poses_in_room(IMAGES)
DESCRIPTORS = descriptors_at(POSES, DIMENSION)


def add(builder, size=70, until=IMAGES):
    """Stream the images that the builder does not have, in chunks."""
    for start in range(builder.images, until, size):
        some = slice(start, min(start + size, until))
        builder.add(POSES[some], DESCRIPTORS[some])


def finish(builder, **changed):
    builder.finish(KERNEL, LIKELIHOOD, **{"neighbours": K, "tile": TILE, "facts": {"from": "a test"}, **changed})


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    """Descriptors are sorted in several blocks, too."""
    monkeypatch.setattr(tiled_map, "BLOCK", 96)
    monkeypatch.setattr("sextant.localization.descriptor_map.BLOCK", 96)


def in_memory(**arguments):
    order = spatial_order(POSES)
    return CachedLocalGP(K, **arguments).fit(DescriptorMap.of(POSES[order], DESCRIPTORS[order]), KERNEL)


@pytest.mark.parametrize("arguments", [{}, {"map_evidence": "mean", "blend": 2}], ids=str)
@pytest.mark.parametrize("runs", [1, 3])
def test_likelihoods_are_those_of_the_map_in_memory(tmp_path, arguments, runs):
    builder = TiledMapBuilder(tmp_path)
    add(builder)
    finish(builder, **arguments)
    saved, known = load_map(tmp_path), in_memory(**arguments)
    assert (saved.likelihood, saved.facts) == (LIKELIHOOD, {"from": "a test"})
    assert saved.model.arguments() == {**known.arguments(), "tile": TILE}
    for name, tensor in known.state().items():
        assert torch.equal(saved.model.state()[name], tensor), name
    assert torch.equal(saved.model.map.mean, known.map.mean)
    poses, images = poses_in_room(60, seed=1).view(1, -1, 3).repeat(runs, 1, 1), descriptors_at(poses_in_room(runs), 12)
    ours, theirs = (model.observe(images, LIKELIHOOD) for model in (saved.model, known))
    assert torch.equal(ours.log_likelihood(poses), theirs.log_likelihood(poses))
    assert torch.equal(ours.over_map(), theirs.over_map())


def test_only_tiles_that_poses_ask_for_are_read(tmp_path):
    builder = TiledMapBuilder(tmp_path)
    add(builder)
    finish(builder)
    model = load_map(tmp_path).model
    evidence = model.observe(DESCRIPTORS[:1], LIKELIHOOD)
    assert evidence.unread.all()
    about = POSES[:1] + 0.01 * torch.randn(30, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    told = evidence.log_likelihood(about[None])
    assert 0 < (~evidence.unread).sum() < len(evidence.unread)
    assert torch.equal(told, in_memory().observe(DESCRIPTORS[:1], LIKELIHOOD).log_likelihood(about[None]))
    evidence.over_map()
    assert not evidence.unread.any()


class Interrupted(Exception):
    """What a user's Ctrl-C does."""


@pytest.mark.parametrize("after", [1, 3, 5, 7, 9, 11, 13])
def test_an_interrupted_builder_is_gone_on_with(tmp_path, after):
    """Interrupted while images are added, then at the given block or tile: of 6 blocks and 8 tiles."""
    add(TiledMapBuilder(tmp_path), until=200)
    builder = TiledMapBuilder(tmp_path)
    assert builder.images == 200
    add(builder)
    told = []

    def interrupt(done, of):
        told.append(done)
        if len(told) == after:
            raise Interrupted

    with pytest.raises(Interrupted):
        finish(builder, progress=interrupt)
    with pytest.raises(UserError, match=r"no map\.json"):
        load_map(tmp_path)
    again, seen = TiledMapBuilder(tmp_path), []
    with pytest.raises(UserError, match="is being finished"):
        again.add(POSES, DESCRIPTORS)
    finish(again, progress=lambda done, of: seen.append(done))
    assert told + seen == [96, 192, 288, 384, 480, 500, 64, 128, 192, 256, 320, 384, 448, 500]
    known = in_memory()
    saved = load_map(tmp_path).model
    assert torch.equal(saved.map.descriptors, known.map.descriptors)
    assert all(torch.equal(tensor, saved.state()[name]) for name, tensor in known.state().items())
    assert {path.name for path in tmp_path.iterdir()} == {
        *("poses.npy", "descriptors.npy", "mean.npy"),
        *("state", HEADER),
    }


def test_a_chunk_that_was_half_written_is_written_again(tmp_path):
    builder = TiledMapBuilder(tmp_path)
    add(builder, until=200)
    with (tmp_path / "incoming/descriptors").open("ab") as file:
        file.write(b"half a chunk")
    add(TiledMapBuilder(tmp_path))
    finish(TiledMapBuilder(tmp_path))
    assert torch.equal(load_map(tmp_path).model.map.descriptors, in_memory().map.descriptors)


def test_with_another_kernel_tiles_are_prepared_anew(tmp_path):
    builder, told = TiledMapBuilder(tmp_path), []
    add(builder)

    def interrupt(done, of):
        told.append(done)
        if len(told) == 9:
            raise Interrupted

    other = PoseKernel("matern32", (0.7, 0.7), 0.5, 1.0, 0.1)
    with pytest.raises(Interrupted):
        builder.finish(other, LIKELIHOOD, neighbours=K, tile=TILE, progress=interrupt)
    finish(TiledMapBuilder(tmp_path))
    saved = load_map(tmp_path).model
    assert all(torch.equal(tensor, saved.state()[name]) for name, tensor in in_memory().state().items())


@pytest.mark.parametrize("name", ["descriptors", "state/grams"])
@pytest.mark.parametrize("damage", ["flipped", "cut"])
def test_a_damaged_file_is_told(tmp_path, name, damage):
    builder = TiledMapBuilder(tmp_path)
    add(builder)
    finish(builder)
    path = tmp_path / f"{name}.npy"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content if damage == "flipped" else content[:-4])
    with pytest.raises(UserError, match=rf"{name}\.npy"):
        load_map(tmp_path)


def test_images_of_other_types_and_numbers_of_numpy_make_the_same_map(tmp_path):
    for name, poses, descriptors in (("a", POSES, DESCRIPTORS), ("b", POSES.float(), DESCRIPTORS.double())):
        builder = TiledMapBuilder(tmp_path / name)
        builder.add(poses.float().double() if name == "a" else poses, descriptors)
        finish(builder, neighbours=np.int64(K), tile=np.int64(TILE), facts={"count": np.int32(3)})
    usual, other = (load_map(tmp_path / name) for name in ("a", "b"))
    assert torch.equal(other.model.map.descriptors, usual.model.map.descriptors)
    assert torch.equal(other.model.map.poses, usual.model.map.poses)
    assert other.facts == {"count": 3}


def test_what_cannot_be_a_map_is_refused(tmp_path):
    builder = TiledMapBuilder(tmp_path)
    with pytest.raises(UserError, match="the map has 1 pose and 20 descriptors"):
        builder.add(POSES[:1], DESCRIPTORS[:20])
    with pytest.raises(UserError, match="no image was added"):
        finish(builder)
    add(builder, until=140)
    broken = DESCRIPTORS[:3].clone()
    broken[1, 0] = torch.nan
    with pytest.raises(UserError, match="the first of them image 141"):
        builder.add(POSES[:3], broken)
    with pytest.raises(UserError, match="descriptors have 5 values, but earlier ones have 12"):
        builder.add(POSES[:3], DESCRIPTORS[:3, :5])
    with pytest.raises(UserError, match=r"neighbours=141 must be in \[1, 140\]"):
        finish(builder, neighbours=141)
    with pytest.raises(UserError, match="of=<object"):
        finish(builder, facts={"of": object()})
    builder.add(POSES[30:31] + torch.tensor([0, 0, 4 * torch.pi], dtype=torch.float64), DESCRIPTORS[:1])
    builder.add(torch.tensor([[1.0, -0.0, 0.5], [1.0, 0.0, 0.5]], dtype=torch.float64), DESCRIPTORS[:2])
    with pytest.raises(UserError, match=r"1 image shares a pose with another .* images 141 and 142"):
        finish(builder)


def test_a_folder_that_holds_something_else_is_refused(tmp_path):
    (tmp_path / "building.json").write_text("{")
    with pytest.raises(UserError, match="is damaged"):
        TiledMapBuilder(tmp_path)
    (tmp_path / "building.json").write_text(json.dumps({"format": "other"}))
    with pytest.raises(UserError, match="does not hold a map being built"):
        TiledMapBuilder(tmp_path)
    (tmp_path / HEADER).write_text("{}")
    with pytest.raises(UserError, match="already holds a map"):
        TiledMapBuilder(tmp_path)


@pytest.mark.slow
@settings(max_examples=60)
@given(st.integers(1, 150), st.integers(1, 40), st.integers(1, 20), st.floats(0.01, 30), st.integers(0, 10**6))
def test_neighbours_of_tiles_are_those_of_a_search_in_the_whole_map(count, size, k, length, seed):
    generator = np.random.default_rng(seed)
    poses = torch.from_numpy(generator.normal(0, (10, 3, 2), (count, 3)) * generator.choice([0.1, 1, 50], (count, 1)))
    poses = poses[spatial_order(poses)]
    k, kernel = min(k, count), PoseKernel("rbf", (length, 0.7 * length), 0.8, 1.0, 0.1)
    tiles = Tiles(poses, kernel, size, least=k)
    found = torch.cat([tiles.neighbours(tile, k) for tile in range(len(tiles))])
    assert torch.equal(torch.cat([tiles.rows(tile) for tile in range(len(tiles))]), torch.arange(count))
    whole = Neighbourhoods(poses, kernel).of_images(torch.arange(count), k).rows
    features = kernel.features(poses)
    squared = [(features[rows] - features[:, None]).square().sum(2) for rows in (found, whole)]
    torch.testing.assert_close(*squared, rtol=1e-9, atol=1e-12)
