import pytest
from cli.photo_calibration.fakes import calibrate, photo

from sextant.data.photo_files import find_photos
from sextant.errors import UserError


def test_photos_are_found_by_file_folder_or_pattern_and_outputs_are_not(tmp_path):
    a, b = photo(tmp_path / "a.jpg"), photo(tmp_path / "sub" / "b.PNG")
    (tmp_path / "note.txt").write_text("")
    assert find_photos(str(a), tmp_path / "out") == [a]
    assert find_photos(str(tmp_path), tmp_path / "out") == [a, b]
    assert find_photos(str(tmp_path / "*.jpg"), tmp_path / "out") == [a]
    assert find_photos(str(tmp_path / "**" / "*.PNG"), tmp_path / "out") == [b]
    calibrate([a, b], tmp_path)
    assert find_photos(str(tmp_path), tmp_path) == [a, b]
    (tmp_path / "empty").mkdir()
    for nowhere, said in {
        "none.jpg": r"none\.jpg does not exist", "aa.jpg": r"did you mean .*/a\.jpg\?", "*.gif": "no photo there",
        "empty": "no photo there",
    }.items():  # fmt: skip
        with pytest.raises(UserError, match=said):
            find_photos(str(tmp_path / nowhere), tmp_path / "out")
