"""Approximations of a Gaussian process over one floor: their differences from the exact one and their costs.

``python -m benchmarks.gp_approximation [csv=<file>] [<key>=<value> ...]``

Keys are those of ``train.py task=localization``; the floor is ``office_walk`` with every fourth of its frames, rendered
once into ``paths.outputs``. The kernel is trained on the map as in that task, then each observation model is fitted to
the same map with it. Poses are 1,000 draws about those of the test drives. In the table

- *mean* is the RMS difference of a model's means from the exact ones, in exact standard deviations of a component,
- *KL* the mean divergence of its Gaussian from the exact one in nats per descriptor component, *KL max* the largest,
- *NLL* the negative log-likelihood of the test drives' images at their true poses in nats per component, with the
  appearance noise of the validation drives, without tempering; test drives have other conditions than the map,
- *tau* Kendall's tau between the weights of 1,000 particles about the true pose and the exact ones, mean over images,
- *us* the time per particle of weighting 1,000, after the image has been compared with the map (*observe*),
- *MB* the memory of a fitted model beside the map, with its cached predictions at the map's own poses.

A sum of kernels is not a Gaussian process: its means and variances are those of its nearest images.
"""

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import TypeVar

import numpy as np
import torch
from rich.console import Console
from rich.table import Table
from scipy.stats import kendalltau

from benchmarks.machine import describe_machine
from sextant.atomic_files import write_csv
from sextant.chapters.localization.data.datamodule import LocalizationDataModule
from sextant.chapters.localization.data.drive import Drive
from sextant.chapters.localization.task import as_tensor
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.errors import UserError
from sextant.geometry.planar import se2_compose
from sextant.localization.calibration import appearance_noise
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.hyperparameters import TrainableKernel, joint_log_likelihood
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation import ObservationModel, observation_model
from sextant.localization.observation.model import Prediction
from sextant.localization.observation.sgpr import SGPR
from sextant.localization.pose_kernel import PoseKernel, Spatial
from sextant.registry import chapter_of

OVERRIDES = ("task=localization", "dataset.every=4", "task.replay=false")
STEPS, RATE = 60, 0.05
PARTICLES, IMAGES, REPEATS = 1000, 24, 7
#: About the true pose: metres along and across, rad.
SPREAD = (0.5, 0.5, math.radians(15))

Make = Callable[[], ObservationModel]
T = TypeVar("T")


@dataclass(frozen=True)
class Floor:
    """The data that all models are fitted to and evaluated on.

    Attributes:
        map: map of one floor.
        kernel: kernel trained on the map.
        validation: images of validation drives and their poses, which noise is fitted on.
        test: images under other conditions and their poses.
        conditions: conditions of the test drives.
    """

    map: DescriptorMap
    kernel: PoseKernel
    validation: tuple[torch.Tensor, torch.Tensor]
    test: tuple[torch.Tensor, torch.Tensor]
    conditions: tuple[str, ...]


@dataclass(frozen=True)
class Judged:
    """The results of one model; see the module's description."""

    model: str
    size: str
    fit_s: float
    mean_sd: float
    kl: float
    kl_max: float
    nll: float
    tau: float
    us_particle: float
    observe_ms: float
    mb: float


def main(arguments: Sequence[str]) -> None:
    file = [argument.removeprefix("csv=") for argument in arguments if argument.startswith("csv=")]
    torch.set_num_threads(1)
    console = Console(width=150)
    try:
        floor = read_floor([argument for argument in arguments if not argument.startswith("csv=")])
    except UserError as error:
        raise SystemExit(str(error)) from None
    told = []
    for judged in judge_all(floor):
        told.append(judged)
        console.print(f"{judged.model} {judged.size}: fitted in {judged.fit_s:.2f} s", highlight=False)
    console.print(describe_machine())
    console.print(
        f"{len(floor.map):,} images x {floor.map.dimension}, test under {', '.join(floor.conditions)}; {floor.kernel}"
    )
    console.print(as_table(told))
    for path in file:
        columns = [field.name for field in fields(Judged)]
        write_csv(Path(path).expanduser(), columns, map(asdict, told))


def models() -> Iterator[tuple[str, str, Make]]:
    """Names, sizes and makers, the exact one first."""
    wanted: list[tuple[str, str, dict[str, float]]] = [("ExactGP", "", {})]
    wanted += [("LocalGP", f"k={k}", {"neighbours": k}) for k in (8, 16, 32)]
    wanted += [("CachedLocalGP", f"k={k}", {"neighbours": k}) for k in (8, 16, 32)]
    wanted += [("SGPR", f"m={m}", {"inducing": m}) for m in (50, 100, 200, 400)]
    wanted += [("SVGP", f"m={m}", {"inducing": m}) for m in (200, 400)]
    wanted += [("SKI", "spacing 1, rank 200", {"spacing": 1.0, "rank": 200})]
    wanted += [("RandomFeatures", f"{f}", {"features": f}) for f in (250, 500, 1000, 2000)]
    wanted += [("KernelSum", "k=3", {"neighbours": 3})]
    for name, size, arguments in wanted:
        yield name, size, partial(observation_model(name), **arguments)


# -- the floor ---------------------------------------------------------------------------------------------------------


def read_floor(overrides: Sequence[str]) -> Floor:
    """Render or read the drives, describe their images, train the kernel."""
    raw = to_plain(compose([*OVERRIDES, *overrides]))
    config = validate(raw)
    family = chapter_of("localization")
    data = family.data(config, family.source(config))
    assert isinstance(data, LocalizationDataModule)
    drives = data.drives
    seen = DescriptorMap.of(torch.from_numpy(drives.map.poses), _descriptors(data, drives.map))
    rows = torch.from_numpy(data.choices(0)[0])
    spatial, ard = raw["kernel"]["spatial"], raw["kernel"]["ard"]
    kernel = trained(seen.poses[rows], seen.descriptors[rows], spatial, ard)
    others = [drive for drive in drives.test if drive.condition != drives.map.condition] or list(drives.test)
    conditions = tuple(dict.fromkeys(drive.condition for drive in others))
    return Floor(seen, kernel, _images(data, drives.validation), _images(data, others), conditions)


def trained(poses: torch.Tensor, descriptors: torch.Tensor, spatial: Spatial, ard: bool) -> PoseKernel:
    """The kernel after some steps up the joint likelihood."""
    kernel = TrainableKernel.from_map(poses, descriptors, spatial=spatial, ard=ard)
    optimizer = torch.optim.Adam(kernel.parameters(), lr=RATE)
    mean = descriptors.mean(0)
    for _ in range(STEPS):
        optimizer.zero_grad()
        loss = -joint_log_likelihood(kernel, poses, descriptors, mean) / descriptors.numel()
        loss.backward()
        optimizer.step()
    return kernel.frozen()


def _images(data: LocalizationDataModule, drives: Sequence[Drive]) -> tuple[torch.Tensor, torch.Tensor]:
    descriptors = torch.cat([_descriptors(data, drive)[torch.from_numpy(drive.seen)] for drive in drives])
    return descriptors, torch.cat([torch.from_numpy(drive.poses[drive.seen]) for drive in drives])


def _descriptors(data: LocalizationDataModule, drive: Drive) -> torch.Tensor:
    return as_tensor(data.descriptors(drive)).clone()


# -- measures ----------------------------------------------------------------------------------------------------------


def judge_all(floor: Floor) -> Iterator[Judged]:
    """Every model compared with the first."""
    asked = about(floor.test[1][_spread(len(floor.test[1]), PARTICLES)], 1)[:, 0]
    _fitted(partial(SGPR, inducing=2), floor)  # imports what the models need
    exact: Prediction | None = None
    weights: torch.Tensor | None = None
    likelihood = Likelihood()
    for name, size, make in models():
        model, fit_s = _timed(partial(_fitted, make, floor))
        predicted = model.predict(asked)
        if exact is None or weights is None:
            likelihood = replace(likelihood, appearance_variance=noise_of(model, floor))
            exact, weights = predicted, weigh(model, floor, likelihood)
        judged = weigh(model, floor, likelihood)
        divergence = kl(exact, predicted)
        us, observe_ms = cost(model, floor, likelihood)
        model.observe(floor.test[0][:1], likelihood).over_map()
        yield Judged(
            name, size, fit_s,
            float(((predicted.mean - exact.mean).square().mean(1) / exact.variance).mean().sqrt()),
            float(divergence.mean()), float(divergence.max()),
            nll(model, floor),
            float(np.mean([kendalltau(ours, theirs).statistic for ours, theirs in zip(judged, weights, strict=True)])),
            us, observe_ms, kept_bytes(model) / 1e6,
        )  # fmt: skip


def kl(exact: Prediction, other: Prediction) -> torch.Tensor:
    """Divergence of the other Gaussian from the exact one, in nats per descriptor component."""
    squared = (other.mean - exact.mean).square().mean(1)
    ratio = exact.variance / other.variance
    return 0.5 * (squared / other.variance + ratio - 1 - ratio.log())


def noise_of(model: ObservationModel, floor: Floor) -> float:
    """Appearance noise on the validation drives."""
    descriptors, poses = floor.validation
    found = model.residuals(descriptors, poses[:, None])
    return appearance_noise(found.squared[:, 0], found.variance[:, 0], model.map.dimension)


def nll(model: ObservationModel, floor: Floor) -> float:
    """Negative log-likelihood of test images at their true poses, in nats per component."""
    descriptors, poses = floor.test
    found = model.residuals(descriptors, poses[:, None])
    told = Likelihood(appearance_variance=noise_of(model, floor)).log_prob(
        found.squared, found.variance, model.map.dimension
    )
    return -float(told.mean()) / model.map.dimension


def weigh(model: ObservationModel, floor: Floor, likelihood: Likelihood) -> torch.Tensor:
    """Log-likelihoods of particles about the true pose of some test images."""
    rows = _spread(len(floor.test[1]), IMAGES)
    poses = about(floor.test[1][rows], PARTICLES)
    evidence = [model.observe(floor.test[0][row : row + 1], likelihood) for row in rows.tolist()]
    return torch.cat([one.log_likelihood(some[None]) for one, some in zip(evidence, poses, strict=True)])


def cost(model: ObservationModel, floor: Floor, likelihood: Likelihood) -> tuple[float, float]:
    """Microseconds per particle and milliseconds per image, medians."""
    image, poses = floor.test[0][:1], about(floor.test[1][:1], PARTICLES)
    weighing, observing = [], []
    for _ in range(REPEATS + 1):
        evidence, seconds = _timed(partial(model.observe, image, likelihood))
        observing.append(seconds)
        weighing.append(_timed(partial(evidence.log_likelihood, poses))[1])
    return 1e6 * median(weighing[1:]) / PARTICLES, 1e3 * median(observing[1:])


def about(poses: torch.Tensor, count: int) -> torch.Tensor:
    """``count`` poses about each."""
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn(len(poses), count, 3, generator=generator, dtype=torch.float64)
    return se2_compose(poses[:, None], noise * torch.tensor(SPREAD, dtype=torch.float64))


def kept_bytes(model: ObservationModel) -> int:
    """Bytes of its state and of its cached predictions at the map's own poses."""
    tensors = [*model.state().values(), *(model._over_map or ())]
    return sum(tensor.numel() * tensor.element_size() for tensor in tensors)


def _spread(count: int, wanted: int) -> torch.Tensor:
    """Rows evenly spaced; repeated if there are too few."""
    return torch.linspace(0, count - 1, wanted).long()


def _fitted(make: Make, floor: Floor) -> ObservationModel:
    return make().fit(floor.map, floor.kernel)


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    began = time.perf_counter()
    done = work()
    return done, time.perf_counter() - began


# -- output ------------------------------------------------------------------------------------------------------------


def as_table(told: Sequence[Judged]) -> Table:
    table = Table("model", "size", "fit s", "mean", "KL", "KL max", "NLL", "tau", "us", "observe ms", "MB")
    for one in told:
        numbers = (
            f"{one.fit_s:.2f}", f"{one.mean_sd:.3f}", f"{one.kl:.2g}", f"{one.kl_max:.2g}", f"{one.nll:.3f}",
            f"{one.tau:.3f}", f"{one.us_particle:.2f}", f"{one.observe_ms:.2f}", f"{one.mb:.1f}",
        )  # fmt: skip
        table.add_row(one.model, one.size, *numbers)
    return table


if __name__ == "__main__":
    main(sys.argv[1:])
