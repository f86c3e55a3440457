"""All corruptions there are, for tests of what they have in common."""

from sextant.corruptions import ContrastPoisson, GaussianNoise, cifar10_c, imagenet_c, mnist_c

SETS = {"cifar10_c": cifar10_c, "imagenet_c": imagenet_c, "mnist_c": mnist_c}
ALL = {
    f"{key}-{name}-{mode}": corruption
    for key, build in SETS.items()
    for mode in ("faithful", "corrected")
    for name, corruption in build(mode=mode).items()
} | {
    f"chapter7-{corruption.name}-{'clipped' if clip else 'loose'}": corruption
    for clip in (False, True)
    for corruption in (GaussianNoise([0.1], clip), ContrastPoisson([0.4], clip=clip))
}


def levels(corruption):
    """Those at which it is defined, or some of them."""
    return list(range(1, len(corruption.table) + 1)) if hasattr(corruption, "table") else [*corruption.levels, 1.0]


def clips(corruption):
    """Whether results stay within [0, 1]."""
    return getattr(corruption, "clip", True)
