from dataclasses import asdict, replace

import pytest

from sextant.atomic_files import write_json
from sextant.runs.directory import RunKey, all_runs, claim

KEY = RunKey("classification", "abcdef0123456789", 3, "code1", "data1")


def begin(outputs, key):
    directory = claim(outputs, key).directory
    directory.update_state(asdict(key))
    return directory


def finish(outputs, key):
    directory = begin(outputs, key)
    write_json(directory.metrics, {"metrics": {}})
    return directory


def test_the_name_is_a_function_of_digest_and_seed(tmp_path):
    found = claim(tmp_path, KEY)
    assert found.directory.path == tmp_path / "runs" / "classification" / "abcdef01-s3"
    assert not found.finished


def test_a_begun_run_is_resumed_in_its_directory(tmp_path):
    directory = begin(tmp_path, KEY)
    assert claim(tmp_path, KEY).directory == directory
    assert not claim(tmp_path, KEY).finished


def test_a_finished_run_is_returned(tmp_path):
    directory = finish(tmp_path, KEY)
    assert claim(tmp_path, KEY).directory == directory
    assert claim(tmp_path, KEY).finished


@pytest.mark.parametrize("field", ["code", "data"])
def test_other_code_or_data_goes_into_a_new_directory_and_says_why(tmp_path, field):
    first = finish(tmp_path, KEY)
    found = claim(tmp_path, replace(KEY, **{field: "other"}))
    assert found.directory.path.name == f"{first.path.name}-2"
    assert not found.finished
    assert found.passed_over == (f"{first.path.name}: {field} changed",)


def test_any_code_forgives_other_code_but_not_other_data(tmp_path):
    first = finish(tmp_path, KEY)
    assert claim(tmp_path, replace(KEY, code="other"), "any_code").directory == first
    assert claim(tmp_path, replace(KEY, data="other"), "any_code").directory != first


def test_an_unfinished_run_of_other_code_is_not_resumed_whatever_the_reuse(tmp_path):
    first = begin(tmp_path, KEY)
    assert claim(tmp_path, replace(KEY, code="other"), "any_code").directory != first


def test_digests_that_share_eight_digits_do_not_share_a_directory(tmp_path):
    first = finish(tmp_path, KEY)
    twin = replace(KEY, digest="abcdef01ffffffff")
    assert claim(tmp_path, twin).directory.path.name == f"{first.path.name}-2"


def test_going_back_to_the_first_code_finds_the_first_run(tmp_path):
    first = finish(tmp_path, KEY)
    second = finish(tmp_path, replace(KEY, code="other"))
    assert first != second
    assert claim(tmp_path, KEY).directory == first
    assert [run.path for run in all_runs(tmp_path)] == [first.path, second.path]
