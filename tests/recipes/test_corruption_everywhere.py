"""``corruption=``, ``backbone=``, ``inhibition=`` and ``pooling=`` for every task: taken, or refused in one line.

The boundaries of the kind: every task with corruptions that are drawn (published sets, noise, none), from files, and in
sequences; what sees no images (a laser, vectors from files); every descriptor with a network of its own, with one from
the config, and without any.
"""

import re

import pytest

from sextant.composing.compose import compose, to_plain
from sextant.config import digest, validate
from sextant.errors import UserError
from sextant.kit.assemble import is_corrupted
from sextant.registry import CHAPTERS, chapter_of

DRAWN = ("none", "gaussian", "contrast_poisson", "pushpull", "cifar10_c", "mnist_c", "imagenet_c")
LANDMARKS = ("descriptor=landmarks", "descriptor.photo=gone.png", "descriptor.points=[[3,4]]")
SCENES = ("experiment=cosfire_places", "features.run=gone")


def checked(*overrides):
    config = validate(to_plain(compose(overrides)))
    chapter_of(config.task.name).check_parts(config)
    return config


@pytest.mark.parametrize("corruption", DRAWN)
@pytest.mark.parametrize("task", CHAPTERS)
def test_every_task_takes_every_corruption_that_is_drawn(task, corruption):
    config = checked(f"task={task}", f"corruption={corruption}")
    assert is_corrupted(config) is (corruption != "none")


FILES = ("corruption=files", "corruption.folder=/nowhere")


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        *(((f"task={task}", *FILES), f"task={task} draws the corruptions of its images and cannot use files")
          for task in ("calibration", "place_recognition", "localization")),
        *(((f"task={task}", "corruption=cifar10_p"), f"task={task} draws the corruptions of its images and cannot "
           "use sequences") for task in ("calibration", "place_recognition", "localization", "cosfire")),
        ((*SCENES, *FILES), "stored corrupted images are labelled with classes, not with places"),
        (("task=localization", "backbone=resnet18"), "backbone=torchvision_backbone(name=resnet18, weights=None): the "
         "descriptor (WhitenedPCA) has no network"),
        (("task=localization", "inhibition=push_pull"), "inhibition=PushPullInhibition"),
        (("task=localization", "pooling=gem"), "pooling=GeM(p=3.0, train_p=True): the descriptor"),
        (("task=localization", "descriptor=hog", "backbone=resnet20"), "the descriptor (Hog) has no network"),
        (("task=localization", "descriptor=pixels", "backbone=resnet20"), "the descriptor (Pixels) has no network"),
        (("task=localization", *LANDMARKS, "backbone=resnet20"), "the descriptor (Landmarks) has no network"),
        (("task=localization", "descriptor=files", "descriptor.folder=x", "backbone=resnet20"), "has no network"),
        (("task=localization", "descriptor=run", "descriptor.run=x", "backbone=resnet20"), "has a network of its own"),
        (("task=localization", "descriptor=network"), "descriptor=network: no backbone is chosen"),
        (("task=localization", "descriptor=network", "backbone=resnet18", "pooling=netvlad"), "has to be trained"),
        (("task=localization", "descriptor=network", "backbone=resnet18", "pooling=mixvpr"), "has to be trained"),
        ((*SCENES, "backbone=resnet18"), ""),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_in_one_line(overrides, says):
    if not says:  # a run's features, and a backbone that they do not need
        checked(*overrides)
        return
    with pytest.raises(UserError, match=re.escape(says)) as told:
        checked(*overrides)
    assert "\n" not in told.value.problem
    assert told.value.fix


@pytest.mark.parametrize("blind", [("observation=laser_beam",), ("descriptor=files", "descriptor.folder=x")])
def test_corruptions_of_what_sees_no_images_are_refused(blind):
    config = checked("task=localization", "corruption=cifar10_c", *blind)
    with pytest.raises(UserError, match="corruption changes images"):
        chapter_of("localization").source(config)


@pytest.mark.parametrize(
    "choices",
    [
        ("backbone=efficientnet_lite0",), ("backbone=resnet18", "inhibition=push_pull"),
        ("backbone=place_cnn", "inhibition=anti_aliasing", "pooling=gem"), ("backbone=resnet20", "pooling=flatten"),
        ("backbone=small_vgg", "pooling=average", "inhibition=none"),
    ],
    ids=" ".join,
)  # fmt: skip
def test_a_backbone_with_its_inhibition_describes_a_map(choices):
    config = checked("task=localization", "descriptor=network", *choices, "corruption=imagenet_c")
    assert digest(config.model_dump(by_alias=True)) != digest(
        checked("task=localization", "descriptor=network", "backbone=resnet50").model_dump(by_alias=True)
    )


def test_scenes_take_a_backbone_as_it_is():
    changes = ("features=network", "backbone=efficientnet_lite0", "features.frozen=true", "inhibition=push_pull")
    checked("experiment=cosfire_places", *changes)
    with pytest.raises(UserError, match="too few images each to train a network"):
        checked("experiment=cosfire_places", "features=network", "backbone=efficientnet_lite0")
