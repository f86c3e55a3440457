"""MNIST-C: 15 corruptions, one severity each, for grey images of 28x28 pixels.

Source: N. Mu and J. Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019; parameters of
``corruptions.py`` in google-research/mnist-c (Apache-2.0), whose shared families have the tables of ImageNet-C.
"""

from dataclasses import replace

from sextant.corruptions.sets.benchmark_set import BENCHMARK_15, BenchmarkSet, Recipe
from sextant.corruptions.sets.imagenet_c import IMAGENET_FAMILIES as SHARED

ONE = ((),)  # a corruption without parameters has one severity

_FAMILIES = {
    "shot_noise": replace(SHARED["shot_noise"], published=(5,)),
    "impulse_noise": replace(SHARED["impulse_noise"], published=(4,)),
    "glass_blur": replace(SHARED["glass_blur"], published=(1,), options={"chance": 0.5}, quirks={"down_only": True}),
    "motion_blur": replace(SHARED["motion_blur"], published=(1,)),
    "shear": Recipe("shapes.Shear", (0.2, 0.4, 0.6, 0.8, 1.0), (2,)),
    "scale": Recipe("shapes.Scale", (1 / 0.9, 1 / 0.8, 1 / 0.7, 1 / 0.6, 1 / 0.5), (3,)),
    "rotate": Recipe("shapes.Rotate", (0.2, 0.4, 0.6, 0.8, 1.0), (2,)),
    "brightness": replace(SHARED["brightness"], published=(5,)),
    "translate": Recipe("shapes.Translate", (1, 2, 3, 4, 5), (3,)),
    "stripe": Recipe("shapes.Stripe", ONE, (1,)),
    "fog": replace(SHARED["fog"], published=(5,)),
    "spatter": replace(SHARED["spatter"], published=(4,)),
    "dotted_line": Recipe("shapes.DottedLine", ONE, (1,)),
    "zigzag": Recipe("shapes.Zigzag", ONE, (1,)),
    "canny_edges": Recipe("shapes.CannyEdges", ONE, (1,)),
}

MNIST_C = BenchmarkSet(
    "mnist_c",
    "MNIST-C (Mu & Gilmer 2019)",
    _FAMILIES,
    {BENCHMARK_15: tuple(_FAMILIES)},
    baseline="none; plain errors",
    image_size=28,
)
