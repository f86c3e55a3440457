"""Anything at all goes into any corruption: a valid batch becomes a valid batch, and the rest is refused, never taken.

``SEXTANT_EXAMPLES=10000 pytest -n 0 --timeout=0 tests/corruptions/test_fuzz.py`` tries more than a few hundred of each.
"""

import numpy as np
import pytest
import torch
from corruptions.every_corruption import ALL, clips, levels
from fuzzing import fuzz
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from sextant.corruptions import corrupt, imagenet_c
from sextant.errors import UserError

DTYPES = (torch.float16, torch.bfloat16, torch.float32, torch.float64)
SIDES = st.integers(1, 24) | st.sampled_from([1, 2, 3, 28, 32, 33])
SEEDS = st.integers(-(2**70), 2**70)


def filled(kind, shape, seed):
    """Images in [0, 1]: noise, two colours, or one, which many formulas divide by."""
    random = torch.rand(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return {
        "noise": random,
        "two colours": random.round(),
        "black": torch.zeros_like(random),
        "white": torch.ones_like(random),
        "grey": torch.full_like(random, 0.5),
        "tiny": random * 1e-40,
    }[kind]


CONTENTS = st.sampled_from(["noise", "two colours", "black", "white", "grey", "tiny"])
#: other layouts in memory of the same values
LAYOUTS = {
    "plain": lambda images: images,
    "channels last": lambda images: images.contiguous(memory_format=torch.channels_last),
    "transposed": lambda images: images.transpose(2, 3).contiguous().transpose(2, 3),
    "a window": lambda images: torch.nn.functional.pad(images, (1, 2, 1, 1))[..., 1:-1, 1:-2],
    "repeated": lambda images: images[:1].expand_as(images),
}


@st.composite
def batches(draw):
    """A valid call: images, a level, indices, a seed."""
    corruption = draw(st.sampled_from(list(ALL.values())))
    count = draw(st.integers(0, 3))
    shape = (count, draw(st.sampled_from([1, 3])), draw(SIDES), draw(SIDES))
    images = filled(draw(CONTENTS), shape, draw(st.integers(0, 99))).to(draw(st.sampled_from(DTYPES)))
    images = LAYOUTS[draw(st.sampled_from(list(LAYOUTS)))](images)
    indices = draw(st.lists(st.integers(0, 2**63 - 1), min_size=count, max_size=count))
    return corruption, images, draw(st.sampled_from(levels(corruption))), indices, draw(SEEDS)


def with_one_value(images, value, place):
    changed = images.contiguous().clone()
    changed.view(-1)[place % changed.numel()] = value
    return changed


#: what makes a call invalid, given images of at least one value
SPOILT = {
    "an index fewer": lambda images, indices, place: (images, indices[1:]),
    "an index more": lambda images, indices, place: (images, [*indices, place]),
    "fractions": lambda images, indices, place: (images, [index + 0.5 for index in indices]),
    "a negative index": lambda images, indices, place: (images, [-1 - place, *indices[1:]]),
    "a nan": lambda images, indices, place: (with_one_value(images, float("nan"), place), indices),
    "an infinity": lambda images, indices, place: (with_one_value(images, float("-inf"), place), indices),
    "a value above 1": lambda images, indices, place: (with_one_value(images, 1.01, place), indices),
    "a value below 0": lambda images, indices, place: (with_one_value(images, -0.01, place), indices),
    "0 to 255": lambda images, indices, place: (with_one_value(images * 255, 255, place), indices),
    "bytes": lambda images, indices, place: ((images * 255).byte(), indices),
    "booleans": lambda images, indices, place: (images > 0.5, indices),
    "complex numbers": lambda images, indices, place: (images.to(torch.complex64), indices),
    "one image": lambda images, indices, place: (images[0], indices),
    "a batch of batches": lambda images, indices, place: (images[None], indices),
    "two channels": lambda images, indices, place: (images[:, :1].expand(-1, 2, -1, -1), indices),
    "no pixels": lambda images, indices, place: (images[..., :0], indices),
    "an array": lambda images, indices, place: (images.float().numpy(), indices),
}


def too_small(corruption, images):
    return corruption.name == "elastic_transform" and min(images.shape[-2:]) < 3


@pytest.mark.slow
@fuzz
@given(batches())
def test_a_valid_batch_becomes_a_valid_batch(case):
    corruption, images, level, indices, seed = case
    before = images.clone()
    if too_small(corruption, images) and len(images):
        with pytest.raises(ValueError, match="at least 3x3 pixels"):
            corruption(images, level, indices, seed)
        return
    corrupted = corruption(images, level, indices, seed)
    assert (corrupted.shape, corrupted.dtype) == (images.shape, images.dtype)
    assert bool(corrupted.isfinite().all())
    if clips(corruption) and corrupted.numel():
        assert corrupted.min() >= 0
        assert corrupted.max() <= 1
    assert torch.equal(corruption(images, level, indices, seed), corrupted)
    assert torch.equal(images, before)


@pytest.mark.slow
@fuzz
@given(batches().filter(lambda case: len(case[1]) > 0), st.sampled_from(list(SPOILT)), st.integers(0, 10**6))
def test_an_invalid_batch_is_refused(case, how, place):
    corruption, images, level, indices, seed = case
    images, indices = SPOILT[how](images, indices, place)
    with pytest.raises(UserError):
        corruption(images, level, indices, seed)


@st.composite
def pictures(draw):
    """One image or a batch, as an array, a tensor or a Pillow image, valid or not."""
    kinds = [np.uint8, np.float16, np.float32, np.float64, np.dtype(">f4"), np.int64, np.uint16, np.bool_, np.complex64]
    kind = np.dtype(draw(st.sampled_from(kinds)))
    sizes = draw(st.lists(st.sampled_from([0, 1, 2, 3, 4, 17, 28]), min_size=0, max_size=5))
    array = np.random.default_rng(draw(st.integers(0, 99))).uniform(size=sizes)
    array = np.asarray(array * 255 if kind.kind in "iu" else array).astype(kind)
    array = array[::-1] if array.ndim and draw(st.booleans()) else array
    form = draw(st.sampled_from(["array", "tensor", "read-only", "pillow", "list"]))
    if form == "tensor" and kind.isnative:
        return torch.from_numpy(array.copy())
    if (
        form == "pillow"
        and kind == np.uint8
        and array.ndim in (2, 3)
        and array.size
        and array.shape[2:] in ((), (3,), (4,))
    ):
        return Image.fromarray(np.ascontiguousarray(array))
    if form == "read-only":
        array.setflags(write=False)
    return array.tolist() if form == "list" else array


def as_array(picture):
    """A copy of its values."""
    return picture.numpy().copy() if isinstance(picture, torch.Tensor) else np.array(picture)


def is_taken(picture):
    """Whether the documentation says that ``corrupt`` takes it."""
    if isinstance(picture, Image.Image):
        return picture.mode in ("L", "RGB")
    if not isinstance(picture, np.ndarray | torch.Tensor):
        return False
    array = as_array(picture)
    if array.dtype != np.uint8 and array.dtype.kind != "f":
        return False
    channels = array.shape[-1 if array.dtype == np.uint8 else -3] if array.ndim in (3, 4) else 1
    return array.ndim in (2, 3, 4) and channels in (1, 3) and 0 not in height_and_width(picture)


def height_and_width(picture):
    """Of what has such."""
    array = as_array(picture)
    if array.ndim == 2:
        return array.shape
    return array.shape[-3:-1] if array.dtype == np.uint8 else array.shape[-2:]


@pytest.mark.slow
@fuzz
@given(pictures(), st.sampled_from(list(imagenet_c())), st.integers(-1, 7), SEEDS)
def test_whatever_is_given_comes_back_as_what_it_was_or_is_refused(picture, name, severity, seed):
    if not is_taken(picture) or severity not in range(1, 6):
        with pytest.raises(UserError):
            corrupt(picture, name, severity, seed)
        return
    before = as_array(picture)
    if name == "elastic_transform" and before.size and min(height_and_width(picture)) < 3:
        with pytest.raises(ValueError, match="at least 3x3 pixels"):
            corrupt(picture, name, severity, seed)
        return
    found = corrupt(picture, name, severity, seed)
    assert isinstance(found, type(picture)) or isinstance(picture, Image.Image)
    assert isinstance(found, Image.Image) == isinstance(picture, Image.Image)
    after = as_array(found)
    assert after.shape == before.shape
    assert after.dtype == before.dtype.newbyteorder("=")
    assert np.array_equal(as_array(picture), before)
    if after.dtype.kind == "f" and after.size:
        assert after.min() >= 0
        assert after.max() <= 1
