"""The paper's figures, recomputed: from means that are stored here, and from the authors' files where there are any."""

import csv
from pathlib import Path

import numpy as np
import pytest
from evaluation.classification.published_results import (
    TABLE_3,
    read_clean_errors,
    read_corruption_details,
    read_labelled,
)

from sextant.errors import UserError
from sextant.evaluation.corruption_difference import corruption_differences
from sextant.evaluation.corruption_errors import (
    ALEXNET_CIFAR10_C,
    ALL_19,
    BENCHMARK_15,
    CorruptionErrors,
    corruption_score,
)
from sextant.evaluation.flips import mean_flip_probability

#: mean error by model and corruption in per cent, as in the authors' ``results/*/*/C_average.txt``, MIT licence
MEANS = Path(__file__).parent / "published" / "push_pull_cifar10_c.csv"

#: E over 19 corruptions, mCE, mean relative CE and E over 15, in per cent, recomputed from the files independently
RECOMPUTED = {
    "resnet-20": (30.289, 103.7, 168.7, 31.49),
    "resnet-20-pp": (29.381, 101.4, 157.9, 30.53),
    "resnet-32": (30.396, 104.1, 171.4, 31.39),
    "resnet-32-pp": (26.634, 91.6, 145.4, 27.68),
    "resnet-44": (28.573, 97.9, 162.2, 29.60),
    "resnet-44-pp": (26.907, 92.3, 148.6, 27.97),
    "resnet-56": (28.643, 97.3, 160.9, 29.86),
    "resnet-56-pp": (26.225, 90.5, 144.3, 27.20),
    "densenet-40-12": (31.248, 106.7, 185.4, 31.80),
    "densenet-40-12-pp": (29.020, 100.3, 166.2, 29.99),
    "densenet-100-12": (25.551, 87.6, 160.0, 26.30),
    "densenet-100-12-pp": (23.847, 82.0, 144.5, 24.62),
    "densenet-100-24": (24.387, 82.5, 152.8, 24.97),
    "densenet-100-24-pp": (21.867, 74.8, 131.3, 22.55),
}
#: files of other runs than the printed table
OTHER_RUNS = {"densenet-40-12", "densenet-40-12-pp", "densenet-100-24", "densenet-100-24-pp"}
#: the mean error that tables 2 and 5 print, where table 3 prints another
PRINTED_ELSEWHERE = {"resnet-20-pp": 29.38}
#: corruptions of 19 on which push-pull has the lower and the higher error; under fog the two ResNet-44 are equal
WINS = {
    "resnet-20": (9, 10),
    "resnet-32": (18, 1),
    "resnet-44": (16, 2),
    "resnet-56": (10, 9),
    "densenet-40-12": (9, 10),
    "densenet-100-12": (13, 6),
    "densenet-100-24": (10, 9),
}
#: p of Wilcoxon's test over the 19 corruptions, from unrounded errors
P_VALUES = {
    "resnet-20": 0.57,
    "resnet-32": 0.00002,
    "resnet-44": 0.0014,
    "resnet-56": 0.184,
    "densenet-40-12": 0.65,
    "densenet-100-12": 0.09,
    "densenet-100-24": 0.13,
}
#: mean flip probability over ten perturbations of CIFAR-10-P, times 100
FLIPS = {
    "resnet-20": 5.47,
    "resnet-20-pp": 5.51,
    "resnet-32": 5.36,
    "resnet-32-pp": 4.73,
    "resnet-44": 5.03,
    "resnet-44-pp": 4.76,
    "resnet-56": 4.64,
    "resnet-56-pp": 4.44,
    "densenet-40-12": 5.18,
    "densenet-40-12-pp": 5.02,
    "densenet-100-12": 3.99,
    "densenet-100-12-pp": 3.57,
    "densenet-100-24": 3.40,
    "densenet-100-24-pp": 3.16,
}


def stored_means():
    with MEANS.open() as file:
        rows = {row.pop("model"): row for row in csv.DictReader(file)}
    return {model: {name: float(value) / 100 for name, value in row.items()} for model, row in rows.items()}


def folder_of(real_data, model):
    kind, _, rest = model.partition("-")
    return real_data / "pushpull_cifar" / "results" / kind / (model if kind == "resnet" else rest)


def check_recomputed(model, errors, rounding=0.0):
    score = corruption_score(errors, ALEXNET_CIFAR10_C, ALL_19)
    found = (score.error, score.mean_ce, score.mean_relative_ce, errors.mean(BENCHMARK_15))
    assert [100 * value for value in found] == pytest.approx(RECOMPUTED[model], abs=0.05 + rounding)
    return score


@pytest.mark.parametrize("model", RECOMPUTED)
def test_the_papers_scores_are_those_of_its_result_files(model):
    errors = CorruptionErrors(TABLE_3[model].clean / 100, {k: (v,) for k, v in stored_means()[model].items()})
    score = check_recomputed(model, errors, rounding=0.01)
    printed = TABLE_3[model]
    same_error = 100 * score.error == pytest.approx(PRINTED_ELSEWHERE.get(model, printed.error), abs=0.011)
    same_ce = round(100 * score.mean_ce) == printed.mean_ce
    same_relative = round(100 * score.mean_relative_ce) == printed.mean_relative_ce
    assert (same_error and same_ce and same_relative) == (model not in OTHER_RUNS)


def test_the_printed_error_of_resnet_20_with_push_pull_is_a_swap_of_digits():
    assert TABLE_3["resnet-20-pp"].error == 29.83
    assert np.mean([*stored_means()["resnet-20-pp"].values()]) == pytest.approx(0.2938, abs=1e-4)


@pytest.mark.parametrize("model", WINS)
def test_wins_over_corruptions_are_those_of_the_files(model):
    means = stored_means()
    arms = ({k: np.array([v]) for k, v in means[name].items()} for name in (f"{model}-pp", model))
    found = corruption_differences(*arms)
    assert (found.wins, found.losses) == WINS[model]


@pytest.mark.real_data
@pytest.mark.parametrize("model", P_VALUES)
def test_p_values_over_corruptions_are_those_of_the_files(real_data, model):
    files = [folder_of(real_data, name) / "C_details.txt" for name in (f"{model}-pp", model)]
    errors = [read_corruption_details(path, 0.0).by_corruption() for path in files]
    found = corruption_differences(*({k: np.array([v]) for k, v in arm.items()} for arm in errors))
    assert (found.wins, found.losses) == WINS[model]
    assert found.p_value == pytest.approx(P_VALUES[model], abs=0.005 if P_VALUES[model] > 0.01 else P_VALUES[model] / 4)


@pytest.mark.real_data
@pytest.mark.parametrize("model", RECOMPUTED)
def test_the_papers_scores_are_recomputed_from_the_authors_files(real_data, model):
    folder = folder_of(real_data, model)
    errors = read_corruption_details(folder / "C_details.txt", TABLE_3[model].clean / 100)
    assert tuple(errors.severities) == ALL_19
    assert {len(values) for values in errors.severities.values()} == {5}
    check_recomputed(model, errors)
    averages = read_labelled(folder / "C_average.txt")
    assert averages == pytest.approx({k: 100 * v for k, v in errors.by_corruption().items()}, abs=0.00501)
    assert averages == pytest.approx({k: 100 * v for k, v in stored_means()[model].items()}, abs=1e-9)


@pytest.mark.real_data
@pytest.mark.parametrize("model", FLIPS)
def test_mean_flip_probabilities_are_recomputed_from_the_authors_files(real_data, model):
    path = folder_of(real_data, model) / "P_flipprob.txt"
    assert 100 * mean_flip_probability(read_labelled(path)) == pytest.approx(FLIPS[model], abs=0.005)


@pytest.mark.real_data
def test_the_clean_errors_in_a_log_are_all_read(real_data):
    errors = read_clean_errors(folder_of(real_data, "densenet-40-12-pp") / "test_clean.txt")
    assert [round(100 * error, 2) for error in errors][:3] == [7.34, 7.34, 7.31]


def test_lines_of_each_file_are_read(tmp_path):
    (tmp_path / "d.txt").write_text("fog: 0.1 0.25 3e-1\n\nsnow: 0.5 1 0\n")
    assert read_corruption_details(tmp_path / "d.txt", 0.05) == CorruptionErrors(
        0.05, {"fog": (0.1, 0.25, 0.3), "snow": (0.5, 1.0, 0.0)}
    )
    (tmp_path / "a.txt").write_text("Distortion: fog   | CE (unnormalized) (%): 49.90\n")
    assert read_labelled(tmp_path / "a.txt") == {"fog": 49.9}
    (tmp_path / "p.txt").write_text(
        "Perturbation: tilt   | Flip Prob: 0.01933\nPerturbation: scale | Flip Prob: 0.06712\n"
    )
    assert read_labelled(tmp_path / "p.txt") == {"tilt": 0.01933, "scale": 0.06712}
    (tmp_path / "c.txt").write_text("Test: [0/79] Prec@1 94.5 (94.5)\n * Prec@1 92.660 \n * Prec@1 92.690 \n")
    assert read_clean_errors(tmp_path / "c.txt") == pytest.approx((0.0734, 0.0731))


@pytest.mark.parametrize(
    ("read", "content", "message"),
    [
        (lambda path: read_corruption_details(path, 0.1), "fog: 0.1 x\n", "line 1 of .*'fog: 0.1 x'.*name: share"),
        (lambda path: read_corruption_details(path, 0.1), "fog: 0.1\nnothing\n", "line 2 of"),
        (lambda path: read_corruption_details(path, 0.1), "fog: 12 14\n", r"shares in \[0, 1\]"),
        (lambda path: read_corruption_details(path, 0.1), " \n", "is empty"),
        (read_labelled, "fog: 0.1\n", "line 1 of .*Perturbation: name"),
        (read_clean_errors, "Prec@1 92\n", "has no line"),
    ],
)
def test_files_of_another_form_are_refused_by_line(tmp_path, read, content, message):
    (tmp_path / "results.txt").write_text(content)
    with pytest.raises(UserError, match=f"(?s){message}"):
        read(tmp_path / "results.txt")


def test_missing_and_binary_files_are_refused(tmp_path):
    with pytest.raises(UserError, match="cannot be read"):
        read_labelled(tmp_path / "none.txt")
    (tmp_path / "none.txt").write_bytes(b"\xff\xfe")
    with pytest.raises(UserError, match="cannot be read"):
        read_labelled(tmp_path / "none.txt")
