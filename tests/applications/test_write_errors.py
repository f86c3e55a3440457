import errno
import os

import pytest

from sextant.applications.write_errors import telling_write_errors
from sextant.errors import UserError


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_full_disk_is_told_with_the_folder_and_what_to_do(tmp_path, number):
    with pytest.raises(UserError, match=r"the disk is full \(.* free\)") as raised, telling_write_errors(tmp_path):
        raise OSError(number, os.strerror(number))
    assert str(tmp_path) in raised.value.problem
    assert "output=/path" in raised.value.fix


def test_a_folder_that_cannot_be_written_to_is_told_with_the_reason(tmp_path):
    with (
        pytest.raises(UserError, match="cannot be written to: Read-only file system") as raised,
        telling_write_errors(tmp_path),
    ):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))
    assert "disk is full" not in raised.value.problem


@pytest.mark.parametrize("error", [UserError("a"), ValueError("b"), KeyboardInterrupt()])
def test_anything_else_passes(tmp_path, error):
    with pytest.raises(type(error)) as raised, telling_write_errors(tmp_path):
        raise error
    assert raised.value is error
