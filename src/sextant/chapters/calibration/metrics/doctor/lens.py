"""Checks of the lens: distortion, its inverse, its gradients, its fold, and agreement with OpenCV."""

import math

import torch
from torch import Tensor

from sextant.chapters.calibration.metrics.doctor.finding import DOUBLE, Finding, largest_bow, random_cameras
from sextant.geometry import (
    Parameterization,
    PerspectiveCamera,
    distort_radius,
    heights_from_pixels,
    horizon_foot,
    horizon_points,
    k2_of_k1,
    max_radius,
    perspective_bearings,
    perspective_project,
    rho_from_tilt,
    undistort_radius,
)
from sextant.geometry.conversions import opencv_from_perspective


def newton_against_bisection() -> list[Finding]:
    """Undistortion against bisection, which only assumes that the polynomial is increasing."""
    k1 = torch.linspace(-0.4, 0.2, 61, dtype=DOUBLE)[:, None]
    k2 = k2_of_k1(k1)
    fold = max_radius(k1, k2)
    radius = torch.linspace(0, 1, 200, dtype=DOUBLE) * torch.minimum(0.98 * fold, torch.full_like(fold, 3.0))
    distorted = distort_radius(radius, k1, k2)
    low, high = torch.zeros_like(radius), torch.minimum(fold, torch.full_like(fold, 20.0)).expand_as(radius).clone()
    for _ in range(80):
        middle = (low + high) / 2
        below = middle * (1 + k1 * middle**2 + k2 * middle**4) < distorted
        low, high = torch.where(below, middle, low), torch.where(below, high, middle)
    error = (undistort_radius(distorted, k1, k2) - low).abs().max().item()
    return [Finding("undistortion", "Newton against bisection, r <= 3", error, 1e-12)]


def implicit_gradients(step: float = 3e-6) -> list[Finding]:
    """Gradients of the undistorted radius against fourth-order finite differences, relative where they are above 1."""
    distorted = torch.linspace(0.05, 1.7, 60, dtype=DOUBLE)[None].repeat(21, 1)
    k1 = torch.linspace(-0.4, 0.0, 21, dtype=DOUBLE)[:, None].repeat(1, 60)
    k2 = k2_of_k1(k1)
    inputs = [value.clone().requires_grad_() for value in (distorted, k1, k2)]
    gradients = torch.autograd.grad(undistort_radius(*inputs).sum(), inputs)
    worst = 0.0
    for i, gradient in enumerate(gradients):
        near, far = (_difference((distorted, k1, k2), i, width) for width in (step, 2 * step))
        difference = (4 * near - far) / 3
        relative = (gradient - difference).abs() / (1 + gradient.abs())
        worst = max(worst, relative.max().item())
    return [Finding("gradients", "implicit against finite differences, relative", worst, 1e-7)]


def _difference(inputs: tuple[Tensor, ...], which: int, step: float) -> Tensor:
    """Central difference of the undistorted radius with respect to one of its inputs."""
    ahead, behind = list(inputs), list(inputs)
    ahead[which], behind[which] = ahead[which] + step, behind[which] - step
    return (undistort_radius(*ahead) - undistort_radius(*behind)) / (2 * step)


def fold_radius(step: float = 1e-4) -> list[Finding]:
    """The fold radius against a search outwards along the polynomial."""
    radius = torch.arange(0, 6, step, dtype=DOUBLE)
    worst = 0.0
    for k1 in torch.tensor([-0.4, -0.2, -0.1, -0.05, -0.02], dtype=DOUBLE):
        for k2 in (torch.zeros_like(k1), k2_of_k1(k1)):
            falling = distort_radius(radius, k1, k2).diff() < 0
            if falling.any():
                worst = max(worst, abs(radius[falling.int().argmax()].item() - max_radius(k1, k2).item()))
    k1 = torch.linspace(-0.4, 0, 4001, dtype=DOUBLE)
    angle = math.degrees(torch.atan(max_radius(k1[0], torch.zeros(()))).item())
    return [
        Finding("fold", "radius against a search outwards", worst, step),
        Finding("fold", "k1 = -0.4, k2 = 0: half-angle, deg", angle, 42.45, 42.35),
        Finding(
            "fold", "family lopez: smallest radius for k1 <= 0", max_radius(k1, k2_of_k1(k1)).min().item(), 3.3, 3.2
        ),
    ]


def straightness(count: int = 200) -> list[Finding]:
    """Bow of straight edges in space, with distortion and after undistortion, in image heights."""
    generator = torch.Generator().manual_seed(1)
    camera = random_cameras(count, 2)
    points = torch.randn(count, 2, 3, generator=generator, dtype=DOUBLE)
    points[..., 2] = points[..., 2].abs() + 1
    share = torch.linspace(0, 1, 50, dtype=DOUBLE)[:, None]
    edge = points[:, :1] + share * (points[:, 1:] - points[:, :1])  # (count, 50, 3)
    lens = (camera.focal[:, None], camera.k1[:, None], k2_of_k1(camera.k1)[:, None])
    seen, visible = perspective_project(edge, *lens)
    whole = visible.all(-1)
    rays = perspective_bearings(seen, *lens)
    ideal = camera.focal[:, None, None] * rays[..., :2] / rays[..., 2:]
    return [
        Finding("straightness", "largest bow of straight edges, distorted", largest_bow(seen[whole]), math.inf, 0.01),
        Finding("straightness", "largest bow of straight edges, undistorted", largest_bow(ideal[whole]), 1e-12),
    ]


def against_opencv() -> list[Finding]:
    """Pixels and rays against OpenCV's, at normalised radii up to 1."""
    import cv2
    import numpy as np

    rng = np.random.default_rng(0)
    angle, radius = rng.uniform(0, 2 * np.pi, 500), np.sqrt(rng.uniform(0, 1, 500))
    ideal = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(500)], -1)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    pixel = ray = 0.0
    for k1 in (-0.4, -0.2, 0.0, 0.2):
        camera = PerspectiveCamera.from_focal(torch.tensor(0.8, dtype=DOUBLE), 640, 480, k1=k1)
        matrix, distortion = (value.numpy() for value in opencv_from_perspective(camera))
        theirs = cv2.projectPoints(ideal, np.zeros(3), np.zeros(3), matrix, distortion)[0][:, 0]
        ours, _ = camera.project(torch.from_numpy(ideal))
        pixel = max(pixel, float(np.abs(theirs + 0.5 - ours.numpy()).max()))
        back = cv2.undistortPoints(theirs[:, None], matrix, distortion, criteria=criteria)[:, 0]
        rays = camera.bearings(torch.from_numpy(theirs + 0.5)).numpy()
        ray = max(ray, float(np.abs(back - rays[:, :2] / rays[:, 2:]).max()))
    return [
        Finding("OpenCV", "projectPoints, r <= 1: pixels", pixel, 1e-9),
        Finding("OpenCV", "undistortPoints, 200 iterations, r <= 1", ray, 1e-9),
    ]


def round_trips(count: int = 20_000) -> list[Finding]:
    """Errors of cameras encoded and decoded by each parameterization."""
    findings = []
    for name in ("direct", "horizon", "undistorted_horizon"):
        worst = 0.0
        for family in ("lopez", "zero"):
            space = Parameterization(name, family)
            truth = random_cameras(count)
            fold = torch.atan(max_radius(truth.k1, space.k2(truth.k1)))
            truth = truth._replace(tilt=torch.minimum(truth.tilt.abs(), 0.95 * fold).copysign(truth.tilt))
            back = space.decode(space.encode(truth))
            worst = max([worst, *((a - b).abs().max().item() for a, b in zip(truth, back, strict=True))])
        findings.append(Finding("round trip", f"{name}: error of {count:,} cameras", worst, 1e-10))
    return findings


def horizon_feet(count: int = 60) -> list[Finding]:
    """The foot of the distorted horizon against a search along the horizon in the image."""
    azimuths = torch.linspace(-1.5, 1.5, 4001, dtype=DOUBLE)
    truth = random_cameras(count, 3, max_tilt=1.0)
    worst = 0.0
    for tilt, roll, focal, k1 in zip(*truth, strict=True):
        camera = PerspectiveCamera.from_focal(focal, 64, 48, k1=k1)
        pixels, visible = horizon_points(camera, tilt, roll, azimuths)
        seen = heights_from_pixels(pixels[visible], 64, 48)
        foot = horizon_foot(rho_from_tilt(tilt, focal, k1, k2_of_k1(k1)), roll)
        worst = max(worst, (seen[seen.norm(dim=-1).argmin()] - foot).abs().max().item())
    return [Finding("horizon", f"foot point of {count} horizons, heights", worst, 1e-9)]


def bow(focal: float, k1: float) -> float:
    """Largest bow, in image heights, of a straight vertical edge that crosses the middle row at u = 0.5."""
    lens = torch.tensor(focal, dtype=DOUBLE), torch.tensor(k1, dtype=DOUBLE), k2_of_k1(torch.tensor(k1, dtype=DOUBLE))
    middle = perspective_bearings(torch.tensor([0.5, 0.0], dtype=DOUBLE), *lens)
    y = torch.linspace(0, 4, 8001, dtype=DOUBLE)
    seen, visible = perspective_project(torch.stack([(middle[0] / middle[2]).expand_as(y), y, y * 0 + 1], -1), *lens)
    return (0.5 - seen[visible & (seen[:, 1] <= 0.5), 0]).abs().max().item()


def bow_test() -> list[Finding]:
    """Equal apparent distortion bends lines equally whatever the focal length; equal k1 does not."""
    focals = (0.5, 0.7, 1.0, 1.4)
    apparent, plain = [bow(f, -0.2 * f * f) for f in focals], [bow(f, -0.2) for f in focals]
    spread = 100 * (max(apparent) / min(apparent) - 1)
    return [
        Finding("bow", "k1_hat = -0.2, f = 0.5 to 1.4: spread, %", spread, 9.0),
        Finding("bow", "k1 = -0.2, the same: largest over smallest", max(plain) / min(plain), math.inf, 4.0),
    ]
