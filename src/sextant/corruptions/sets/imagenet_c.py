"""ImageNet-C: 15 corruptions and 4 extra ones, five severities each, for images of 224x224 pixels.

Source: D. Hendrycks and T. Dietterich, "Benchmarking neural network robustness to common corruptions and
perturbations", ICLR 2019; parameters of ``imagenet_c/corruptions.py`` in hendrycks/robustness (Apache-2.0).
"""

from sextant.corruptions.sets.benchmark_set import BENCHMARK_15, EXTRA_4, BenchmarkSet, Recipe

IMAGENET_FAMILIES = {
    "gaussian_noise": Recipe("noise.ClippedGaussianNoise", (0.08, 0.12, 0.18, 0.26, 0.38)),
    "shot_noise": Recipe("noise.ShotNoise", (60, 25, 12, 5, 3)),
    "impulse_noise": Recipe("noise.ImpulseNoise", (0.03, 0.06, 0.09, 0.17, 0.27)),
    "defocus_blur": Recipe("blur.DefocusBlur", ((3, 0.1), (4, 0.5), (6, 0.5), (8, 0.5), (10, 0.5))),
    "glass_blur": Recipe("blur.GlassBlur", ((0.7, 1, 2), (0.9, 2, 1), (1, 2, 3), (1.1, 3, 2), (1.5, 4, 2))),
    "motion_blur": Recipe("blur.MotionBlur", ((10, 3), (15, 5), (15, 8), (15, 12), (20, 15))),
    "zoom_blur": Recipe("blur.ZoomBlur", ((1.11, 0.01), (1.16, 0.01), (1.21, 0.02), (1.26, 0.02), (1.31, 0.03))),
    "snow": Recipe(
        "weather.Snow",
        (
            (0.1, 0.3, 3, 0.5, 10, 4, 0.8),
            (0.2, 0.3, 2, 0.5, 12, 4, 0.7),
            (0.55, 0.3, 4, 0.9, 12, 8, 0.7),
            (0.55, 0.3, 4.5, 0.85, 12, 8, 0.65),
            (0.55, 0.3, 2.5, 0.85, 12, 12, 0.55),
        ),
    ),
    "frost": Recipe("weather.Frost", ((1, 0.4), (0.8, 0.6), (0.7, 0.7), (0.65, 0.7), (0.6, 0.75))),
    "fog": Recipe("weather.Fog", ((1.5, 2), (2, 2), (2.5, 1.7), (2.5, 1.5), (3, 1.4)), options={"map_size": 256}),
    "brightness": Recipe("weather.Brightness", (0.1, 0.2, 0.3, 0.4, 0.5)),
    "contrast": Recipe("digital.Contrast", (0.4, 0.3, 0.2, 0.1, 0.05)),
    "elastic_transform": Recipe(
        "digital.ElasticTransform",
        ((2, 0.7, 0.1), (2, 0.08, 0.2), (0.05, 0.01, 0.02), (0.07, 0.01, 0.02), (0.12, 0.01, 0.02)),
        quirks={"unit": 244 / 224},
    ),
    "pixelate": Recipe("digital.Pixelate", (0.6, 0.5, 0.4, 0.3, 0.25)),
    "jpeg_compression": Recipe("digital.JPEGCompression", (25, 18, 15, 10, 7)),
    "speckle_noise": Recipe("noise.SpeckleNoise", (0.15, 0.2, 0.35, 0.45, 0.6)),
    "gaussian_blur": Recipe("blur.GaussianBlur", (1, 2, 3, 4, 6)),
    "spatter": Recipe(
        "weather.Spatter",
        (
            (0.65, 0.3, 4, 0.69, 0.6, 0),
            (0.65, 0.3, 3, 0.68, 0.6, 0),
            (0.65, 0.3, 2, 0.68, 0.5, 0),
            (0.65, 0.3, 1, 0.65, 1.5, 1),
            (0.67, 0.4, 1, 0.65, 1.5, 1),
        ),
    ),
    "saturate": Recipe("digital.Saturate", ((0.3, 0), (0.1, 0), (2, 0), (5, 0.1), (20, 0.2))),
}

IMAGENET_C = BenchmarkSet(
    "imagenet_c",
    "ImageNet-C (Hendrycks & Dietterich 2019)",
    IMAGENET_FAMILIES,
    {BENCHMARK_15: tuple(IMAGENET_FAMILIES)[:15], EXTRA_4: tuple(IMAGENET_FAMILIES)[15:]},
    baseline="AlexNet (Hendrycks & Dietterich 2019)",
    image_size=224,
)
