"""CIFAR-10-C: 15 corruptions and 4 extra ones, five severities each, for images of 32x32 pixels.

Source: D. Hendrycks and T. Dietterich, "Benchmarking neural network robustness to common corruptions and
perturbations", ICLR 2019; parameters of ``make_cifar_c.py`` in hendrycks/robustness (Apache-2.0).
"""

from dataclasses import replace

from sextant.corruptions.sets.benchmark_set import BENCHMARK_15, EXTRA_4, BenchmarkSet, Recipe

_FAMILIES = {
    "gaussian_noise": Recipe("noise.ClippedGaussianNoise", (0.04, 0.06, 0.08, 0.09, 0.10)),
    "shot_noise": Recipe("noise.ShotNoise", (500, 250, 100, 75, 50)),
    "impulse_noise": Recipe("noise.ImpulseNoise", (0.01, 0.02, 0.03, 0.05, 0.07)),
    "defocus_blur": Recipe("blur.DefocusBlur", ((0.3, 0.4), (0.4, 0.5), (0.5, 0.6), (1, 0.2), (1.5, 0.1))),
    "glass_blur": Recipe("blur.GlassBlur", ((0.05, 1, 1), (0.25, 1, 1), (0.4, 1, 1), (0.25, 1, 2), (0.4, 1, 2))),
    "motion_blur": Recipe("blur.MotionBlur", ((6, 1), (6, 1.5), (6, 2), (8, 2), (9, 2.5))),
    "zoom_blur": Recipe("blur.ZoomBlur", ((1.06, 0.01), (1.11, 0.01), (1.16, 0.01), (1.21, 0.01), (1.26, 0.01))),
    "snow": Recipe(
        "weather.Snow",
        (
            (0.1, 0.2, 1, 0.6, 8, 3, 0.95),
            (0.1, 0.2, 1, 0.5, 10, 4, 0.9),
            (0.15, 0.3, 1.75, 0.55, 10, 4, 0.9),
            (0.25, 0.3, 2.25, 0.6, 12, 6, 0.85),
            (0.3, 0.3, 1.25, 0.65, 14, 12, 0.8),
        ),
    ),
    "frost": Recipe(
        "weather.Frost", ((1, 0.2), (1, 0.3), (0.9, 0.4), (0.85, 0.4), (0.75, 0.45)), options={"shrink": 0.2}
    ),
    "fog": Recipe("weather.Fog", ((0.2, 3), (0.5, 3), (0.75, 2.5), (1, 2), (1.5, 1.75)), options={"map_size": 32}),
    "brightness": Recipe("weather.Brightness", (0.05, 0.1, 0.15, 0.2, 0.3)),
    "contrast": Recipe("digital.Contrast", (0.75, 0.5, 0.4, 0.3, 0.15)),
    "elastic_transform": Recipe(
        "digital.ElasticTransform",
        ((0, 0, 0.08), (0.05, 0.2, 0.07), (0.08, 0.06, 0.06), (0.1, 0.04, 0.05), (0.1, 0.03, 0.03)),
    ),
    "pixelate": Recipe("digital.Pixelate", (0.95, 0.9, 0.85, 0.75, 0.65)),
    "jpeg_compression": Recipe("digital.JPEGCompression", (80, 65, 58, 50, 40)),
    "speckle_noise": Recipe("noise.SpeckleNoise", (0.06, 0.1, 0.12, 0.16, 0.2)),
    "gaussian_blur": Recipe("blur.GaussianBlur", (0.4, 0.6, 0.7, 0.8, 1)),
    "spatter": Recipe(
        "weather.Spatter",
        (
            (0.62, 0.1, 0.7, 0.7, 0.5, 0),
            (0.65, 0.1, 0.8, 0.7, 0.5, 0),
            (0.65, 0.3, 1, 0.69, 0.5, 0),
            (0.65, 0.1, 0.7, 0.69, 0.6, 1),
            (0.65, 0.1, 0.5, 0.68, 0.6, 1),
        ),
    ),
    "saturate": Recipe("digital.Saturate", ((0.3, 0), (0.1, 0), (1.5, 0), (2, 0.1), (2.5, 0.2))),
}

CIFAR10_C = BenchmarkSet(
    "cifar10_c",
    "CIFAR-10-C (Hendrycks & Dietterich 2019)",
    _FAMILIES,
    {BENCHMARK_15: tuple(_FAMILIES)[:15], EXTRA_4: tuple(_FAMILIES)[15:]},
    baseline="none in most of the literature; AlexNet (Strisciuglio et al. 2020) for corruption errors of push-pull",
    image_size=32,
)
#: the same recipe on the images of CIFAR-100
CIFAR100_C = replace(
    CIFAR10_C, key="cifar100_c", title="CIFAR-100-C (Hendrycks & Dietterich 2019)", baseline="none in the literature"
)
