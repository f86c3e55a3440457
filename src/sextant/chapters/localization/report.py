"""The report of a localization test: arrays by run, metrics, a table, figures, trajectories and animations."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.localization.data.drive import LocalizationData
from sextant.chapters.localization.data.pose_formats import write_tum
from sextant.chapters.localization.judged import Judged, axes_of
from sextant.chapters.localization.testing import Trial
from sextant.chapters.localization.validation import protocol_of
from sextant.evaluation.pose_posterior import posterior_calibration
from sextant.evaluation.protocols import LocalizationProtocol
from sextant.evaluation.success import NEVER, Share
from sextant.evaluation.trajectory_error import pooled_errors
from sextant.localization.map_support import images_near
from sextant.tables import number
from sextant.training.peak_memory import peak_memory_mb
from sextant.worlds.occupancy import OCCUPIED, occupancy_from_scans

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sextant.chapters.localization.figures.particles import ParticleFrame

#: number of runs drawn for each trial
DRAWN = 4
#: cell size of the grid from which walls are drawn
DRAWN_WALLS_M = 0.1


def name_of(trial: Trial, trials: Sequence[Trial]) -> str:
    """A short name of a trial: its condition or drive, its fault and particles where these differ, its corruption."""
    parts = [_drive_of(trial, trials)]
    if len({t.fault for t in trials}) > 1 or trial.fault != "none":
        parts.append(trial.fault)
    if len({t.particles for t in trials}) > 1:
        parts.append(f"{trial.particles} particles")
    if trial.corruption:
        parts.append(trial.corruption)
    return ", ".join(parts)


def _drive_of(trial: Trial, trials: Sequence[Trial]) -> str:
    """The condition of a trial, or its drive where several are of one condition."""
    clean = [t for t in trials if not t.corruption]
    several = len({t.drive for t in clean}) > len({t.condition for t in clean})
    return trial.drive.removesuffix(f", {trial.corruption}") if several else trial.condition


def arrays(found: Mapping[str, Judged]) -> dict[str, ndarray]:
    """Results by run of every trial; for corrupted images only success, as ``corrupted/<trial>/<corruption>``."""
    result: dict[str, ndarray] = {}
    for name, judged in found.items():
        if corruption := judged.outcome.trial.corruption:
            of = name.removesuffix(f", {corruption}")
            result[f"corrupted/{of}/{corruption}"] = judged.found.astype(np.float64)
            continue
        result |= {
            f"success/{name}": judged.found.astype(np.float64),
            f"converged/{name}": judged.converged,
            f"position_error/{name}": judged.position.astype(np.float32),
            f"heading_error_deg/{name}": judged.heading_deg.astype(np.float32),
            f"mass/{name}": judged.outcome.track.mass.T.astype(np.float32),
            f"nll/{name}": judged.outcome.nll.T.astype(np.float32),
        }
    return result


def metrics(found: Mapping[str, Judged], data: LocalizationData) -> dict[str, float]:
    """The metrics of every trial, under names that state the protocol."""
    protocol, values, dof = protocol_of(data), dict[str, float](), len(axes_of(data))
    for name, judged in found.items():
        key = name.replace(", ", "/").replace(" ", "_")
        told = _figures(judged, dof)
        values |= {f"test/{protocol.name(figure)}/{key}": value for figure, value in told.items() if value == value}
    values["test/success"] = float(np.mean([judged.found.mean() for judged in found.values()]))
    values["test/peak_memory_mb"] = peak_memory_mb()
    return values


def _figures(judged: Judged, dof: int) -> dict[str, float]:
    track, later = judged.outcome.track, judged.after
    told = {
        "success": float(judged.found.mean()),
        "converged": judged.summary.share.rate,
        "frames_to_converge_median": judged.summary.median_frames,
        "frames_to_converge_p90": judged.summary.p90_frames,
        "tracking": judged.summary.tracking,
        "position_error_median": _median(judged.position[later]),
        "position_error_rmse": _rmse(judged.position[later]),
        "heading_error_deg_median": _median(judged.heading_deg[later]),
        "error_of_all_frames_median": _median(judged.position[judged.outcome.runs.inside.T]),
        "pose_nll": _mean(judged.outcome.nll.T[later]),
        "ess": float(np.mean(track.ess)),
        "particles": float(np.mean(track.particles)),
        "ms_per_step_of_all_runs": 1e3 * _mean(track.seconds[min(1, len(track.seconds) - 1) :]),  # the first compiles
    }
    if judged.recovery is not None:
        told |= {
            "recovered": judged.recovery.share.rate,
            "frames_to_recover_median": judged.recovery.median_frames,
            "frames_to_recover_p90": judged.recovery.p90_frames,
        }
    told |= _trajectory_figures(judged, headed=dof > 1)
    return told | _regions(judged, dof)


def _regions(judged: Judged, dof: int) -> dict[str, float]:
    """How errors from convergence on compare with the reported covariances; empty if no step has a finite NEES."""
    if not len(judged.nees) or not np.isfinite(judged.nees).any():
        return {}
    calibration = posterior_calibration(judged.nees, dof, independent=len(judged.found))
    return {"nees_median": calibration.median, "coverage_95": calibration.coverage[0.95]}


def _trajectory_figures(judged: Judged, *, headed: bool) -> dict[str, float]:
    """RMS errors of runs from convergence to their end or kidnap: after alignment (ATE), and of each step (RPE)."""
    runs = judged.outcome.runs
    ends = np.where(runs.kidnapped_at < 0, runs.lengths, runs.kidnapped_at)
    spans = [
        (int(begin), int(end)) if begin != NEVER else (0, 0) for begin, end in zip(judged.converged, ends, strict=True)
    ]
    aligned, step, step_deg = pooled_errors(runs.poses, judged.outcome.track.pose, spans)
    values = {"ate_aligned_rmse": _rmse(aligned), "rpe_rmse": _rmse(step)}
    return values | ({"rpe_deg_rmse": _rmse(step_deg)} if headed else {})


def table(found: Mapping[str, Judged], data: LocalizationData) -> list[dict[str, str]]:
    """A row for each trial; *in region* is the share of 95 % regions that contain the true pose."""
    rows, dof = [], len(axes_of(data))
    for name, judged in found.items():
        share, later = judged.summary.share, judged.after
        row = {
            "drive": name,
            "runs": str(share.runs),
            "converged %": f"{100 * share.rate:.0f}",
            "95 %": f"{100 * share.low:.0f}-{100 * share.high:.0f}",
            "frames": number(judged.summary.median_frames, 0),
            "p90": number(judged.summary.p90_frames, 0),
            "tracking %": number(100 * judged.summary.tracking, 1),
            "error": number(_median(judged.position[later]), 2),
            "deg": number(_median(judged.heading_deg[later]), 1),
            "in region %": number(100 * _regions(judged, dof).get("coverage_95", math.nan), 0),
            "NLL": number(_mean(judged.outcome.nll.T[later]), 2),
        }
        if any(other.recovery is not None for other in found.values()):
            again = judged.recovery
            row["recovered %"] = "" if again is None else f"{100 * again.share.rate:.0f}"
            row["in frames"] = "" if again is None else number(again.median_frames, 0)
        row["ms/step/run"] = f"{1e3 * float(np.median(judged.outcome.track.seconds)) / share.runs:.2f}"
        rows.append(row)
    return rows


def facts(found: Mapping[str, Judged], protocol: LocalizationProtocol) -> dict[str, object]:
    """The protocol by which success was judged, and the number of degenerate steps."""
    return {
        "success_protocol": {
            "position": protocol.position,
            "unit": protocol.unit,
            "heading_deg": protocol.heading_deg,
            "frames": protocol.frames,
        },
        "degenerate_steps": {name: int(judged.outcome.track.degenerate.sum()) for name, judged in found.items()},
    }


def figures(found: Mapping[str, Judged], data: LocalizationData) -> Iterator[tuple[str, "Figure"]]:
    """Figures of errors over time, and of success by number of particles."""
    from sextant.chapters.localization.figures.success_curves import SuccessCurve, success_curves
    from sextant.chapters.localization.figures.trajectories import RunErrors, trajectory_errors

    protocol = protocol_of(data)
    for name, judged in found.items():
        drawn = {}
        for run in range(min(DRAWN, len(judged.position))):
            at, taken = int(judged.converged[run]), int(judged.outcome.runs.kidnapped_at[run])
            drawn[f"run {run}"] = RunErrors(
                judged.position[run],
                judged.heading_deg[run],
                None if at == NEVER else at,
                () if taken < 0 else (taken,),
            )
        yield f"errors_{_file(name)}", trajectory_errors(drawn, protocol)
    by_particles = shares_by_particles(found)
    if max(map(len, by_particles.values())) > 1:
        curves = {}
        for name, shares in by_particles.items():
            rates = np.array([(share.rate, share.low, share.high) for share in shares.values()])
            curves[name] = SuccessCurve(np.array(list(shares)), *rates.T)
        yield "success_by_particles", success_curves(curves)


def shares_by_particles(found: Mapping[str, Judged]) -> dict[str, dict[int, Share]]:
    """The share of runs that converged by ascending number of particles, of each drive, fault and corruption."""
    shares: dict[str, dict[int, Share]] = {}
    trials = [judged.outcome.trial for judged in found.values()]
    for judged in sorted(found.values(), key=lambda each: each.outcome.trial.particles):
        trial = judged.outcome.trial
        parts = (_drive_of(trial, trials), "" if trial.fault == "none" else trial.fault, trial.corruption)
        shares.setdefault(", ".join(filter(None, parts)), {})[trial.particles] = judged.summary.share
    return shares


def write_trajectories(found: Mapping[str, Judged], folder: Path) -> None:
    """Write the true and estimated first run of each trial in the TUM format, with a step as a second."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, judged in found.items():
        length = int(judged.outcome.runs.lengths[0])
        times = np.arange(length, dtype=np.float64)
        write_tum(folder / f"{_file(name)}_estimate.tum", times, judged.outcome.track.pose[:length, 0])
        write_tum(folder / f"{_file(name)}_truth.tum", times, judged.outcome.runs.poses[:length, 0])


def write_replays(found: Mapping[str, Judged], data: LocalizationData, folder: Path) -> None:
    """Write animations of the particles of each trial's first run over the map."""
    from sextant.chapters.localization.figures.particles import particle_replay

    folder.mkdir(parents=True, exist_ok=True)
    seen = data.map.images is not None
    walls = _walls(data) if any(judged.outcome.replay for judged in found.values()) else None
    for name, judged in found.items():
        outcome = judged.outcome
        if not outcome.replay:
            continue
        path = folder / f"replay_{_file(name)}.gif"
        particle_replay(
            data.map.poses[:, :2], _moments(name, judged, data), path, unit=data.unit, seen=seen, walls=walls
        )


def _moments(name: str, judged: Judged, data: LocalizationData) -> "Iterator[ParticleFrame]":
    """The first run of a trial, step by step, with the images of the camera if there are any."""
    from sextant.chapters.localization.figures.particles import ParticleFrame

    outcome, map_images = judged.outcome, data.map.images
    runs, track = outcome.runs, outcome.track
    images = next(drive.images for drive in data.test if drive.name == outcome.trial.drive)
    near = images_near(torch.from_numpy(data.map.poses))
    for step in range(int(runs.lengths[0])):
        pose = track.pose[step, 0]
        nearest = int(near.nearest(torch.from_numpy(pose)[None])[0])
        yield ParticleFrame(
            outcome.replay[step][0].astype(np.float64),
            np.log(np.maximum(outcome.replay[step][1], 1e-38)).astype(np.float64),
            pose,
            runs.poses[step, 0],
            f"{name}, step {step}, error {judged.position[0, step]:.2f}",
            runs.poses[: step + 1, 0, :2],
            track.covariance[step, 0, :2, :2],
            images[int(runs.frames[step, 0])] if images is not None and runs.seen[step, 0] else None,
            None if map_images is None else map_images[nearest],
        )


def _walls(data: LocalizationData) -> Float64[ndarray, "w 2"] | None:
    """Points on walls, from the laser scans of the map; None without a laser."""
    if data.scanner is None or data.map.laser is None:
        return None
    grid = occupancy_from_scans(data.scanner, data.map.poses, np.asarray(data.map.laser, np.float64), DRAWN_WALLS_M)
    return grid.cell_to_world(np.argwhere(grid.cells == OCCUPIED))


def _file(name: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in name)


def _median(values: ndarray) -> float:
    return float(np.median(values)) if len(values) else math.nan


def _rmse(errors: ndarray) -> float:
    return math.sqrt(float(np.mean(errors**2))) if len(errors) else math.nan


def _mean(values: ndarray) -> float:
    return float(values.mean()) if len(values) else math.nan
