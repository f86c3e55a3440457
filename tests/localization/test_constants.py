"""Numbers that were chosen by hand stand in one module, and are few."""

import ast
from itertools import pairwise
from pathlib import Path

import sextant.localization
from sextant.localization import constants

LIBRARY = Path(sextant.localization.__file__).parent
CHAPTER = LIBRARY.parent / "chapters" / "localization"
#: what limits computing, rounding or the fit of a kernel, by module and name or function; none changes an estimate
#: beyond noise. The level of regions in ``estimate`` is that of reports, the quantiles of ``evidence_scale`` are
#: published, and those of ``constant_velocity`` are a normal one's
LIMITS = {
    "adaptation": {"COMPARED": [600], "start": [5]},
    "constant_velocity": {"MOST": [100], "NORMAL": [1.349], "_agreed": [0.25, 0.75]},
    "descriptor_map": {"BLOCK": [16384], "NAMED": [5]},
    "estimate": {"MODE": [0.95], "BOX_MASS MODE": [8], "BOXES": [64], "_heaviest_boxes": [1e-9]},
    "evidence_scale": {"LOOKED_AT": [4096], "updated": [0.025, 0.975]},
    "hyperparameters": {
        "SAME": [1e-9], "BLOCK": [16384], "STEPS_OF_LENGTH": [4.0], "NOISE_SHARE": [0.2], "HEADING_LENGTH": [0.7],
        "LEAST_NOISE": [1e-4], "ROUNDING": [1e-10], "SMOOTHNESS": [1.5, 2.5],
    },
    "innovation_test": {"LOOKED_AT ASKED": [4096, 128]},
    "map_prior": {"LEAST_SPACING": [1e-6]},
    "map_support": {"LOOKED_AT NEIGHBOURS": [4096, 24]},
    "pose_kernel": {"_falling": [5]},
    "recognition": {"MOST": [256], "BLOCK": [24], "of": [1e-12]},
    "recovery.bayes_restart": {"share": [0.1], "window": [1000]},  # of the particles; a range
    "resampling": {"BELOW_ONE": [1e-9]},
    "saved_map": {"SMALL": [16]},
    "smoothing": {"DRAWS": [4096], "LEAST": [1e-3, 1e-3, 1e-3], "ELSEWHERE": [18.0], "CHUNK": [256]},
    "tiled_map": {
        "BITS": [31], "SLACK": [1e-9], "TILE": [4096], "finish": [16],
        "_spread": [16, 0x0000FFFF0000FFFF, 8, 0x00FF00FF00FF00FF, 0x0F0F0F0F0F0F0F0F, 0x3333333333333333,
                    0x5555555555555555],
    },
    "localizer": {"from_images": [60, 16]},
    "localizer_arguments": {"MOST_PARTICLES": [1_000_000]},
    "localized_drive": {"MISTAKEN": [1.1]},  # of a remark
    "saved_filter": {
        "FITTED_TO": [600], "LEARNING_RATE": [0.05], "fitted_kernel": [60],
        "LEAST_PARTICLES MOST_USUAL": [2000, 10_000],
    },
}  # fmt: skip
#: settings of parts that a configuration names in place of those of the default localizer
ALTERNATIVES = {
    "calibration": {"SHRINKAGE": [0.2]},
    "interpolated_retrieval": {"LEAST_WEIGHT": [1e-6]},
    "kld_size": {
        "epsilon": [0.05], "delta": [0.01], "minimum": [100], "maximum": [10_000], "heading_bin_rad": [10],
        "tolerance": [0.2], "wanted": [9],
    },
    "likelihood": {"dof": [4.0]},
    "motion": {
        "GOLDEN math": [5],  # of the golden ratio
        "STEPS_IF_UNKNOWN": [20.0], "per_step": [0.025, 0.01, 0.015], "alphas": [0.2] * 4, "least_translation": [0.01],
        "unknown": [0.2, 0.2],
    },
    "metric_pose": {
        "LEAST_FITTED": [20], "UNFITTED": [3.0, 0.1], "LIMITS": [100.0, 50.0, 30.0, 20.0, 10.0, 5.0], "NORMAL": [50.0],
        "planar_pose": [6, 1e-12], "fitted": [0.1, 100, 7.0, 0.001, 1e-5], "log_density": [1.5],
        "_inverse_gamma": [1e-300],
    },
    "motion_density": {"PAIRS": [2_000_000], "_summed": [1.5]},
    "recovery.augmented": {"alpha_slow": [0.001], "alpha_fast": [0.1]},
    "recovery.metric_proposal": {"share": [0.1], "log_prior": [1.5]},
    "recovery.recovery": {"share": [0.05]},
    "recovery.top_k": {"share": [0.05], "top": [10]},
}  # fmt: skip
#: observation models are approximations of one posterior, and lasers another sensor
ELSEWHERE = {"observation", "laser"}


def modules():
    for path in sorted(LIBRARY.rglob("*.py")):
        name = ".".join(path.relative_to(LIBRARY).with_suffix("").parts)
        if name != "constants" and name.split(".")[0] not in ELSEWHERE:
            yield name, path
    for name in ("localizer", "localizer_arguments", "localized_drive", "saved_filter"):
        yield name, CHAPTER / f"{name}.py"


def is_plain(value):
    """Numbers of mathematics, and of rows and columns."""
    return value in (0, 1, 2, 0.5) or (isinstance(value, int) and value in (3, 4))


def numbers(node, owner=""):
    """The other numbers in code, each with the name it is given or the function it is in."""
    for child in ast.iter_child_nodes(node):
        inner = owner
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            inner = child.name
        elif isinstance(child, ast.Assign) and isinstance(node, ast.Module):
            inner = " ".join(name.id for name in ast.walk(child) if isinstance(name, ast.Name))
        elif isinstance(child, ast.AnnAssign) and isinstance(child.target, ast.Name):
            inner = child.target.id
        if isinstance(child, ast.Constant) and type(child.value) in (int, float) and not is_plain(child.value):
            yield inner, child.value
        yield from numbers(child, inner)


def entries():
    """The lines of the module that set a number, each with the line before it."""
    lines = Path(constants.__file__).read_text().splitlines()
    return [(line, before) for before, line in pairwise(lines) if line[:1].isupper()]


def test_they_are_few_and_each_has_its_reason():
    found = {name: value for name, value in vars(constants).items() if name.isupper()}
    assert all(isinstance(value, int | float) for value in found.values())  # one number an entry
    assert len(found) <= 20, sorted(found)  # one more is ``MODE_MASS`` of the protocols
    named = [name for line, _ in entries() if " = " in line for name in line.split(" = ")[0].split(", ")]
    assert sorted(named) == sorted(found)
    assert all(before.startswith("#: ") for line, before in entries() if " = " in line)


def test_each_is_used():
    nodes = [node for _, path in modules() for node in ast.walk(ast.parse(path.read_text()))]
    read = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
    assert {name for name in vars(constants) if name.isupper()} <= read


def test_there_are_no_others():
    for name, path in modules():
        found = {}
        for owner, value in numbers(ast.parse(path.read_text())):
            found.setdefault(owner, []).append(value)
        assert found == LIMITS.get(name, {}) | ALTERNATIVES.get(name, {}), name
