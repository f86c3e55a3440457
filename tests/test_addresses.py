"""Paths in addresses: whatever a folder is called, its database and files are in it and nowhere else."""

import sqlite3

import pytest
from odd_names import NOT_UTF8, ODD_NAMES

from sextant.addresses import file_uri, path_of, read_only, sqlite_uri
from sextant.errors import UserError

named = pytest.mark.parametrize("name", ODD_NAMES, ids=ascii)


@named
def test_an_address_is_read_back_as_its_path(tmp_path, name):
    path = tmp_path / name / "some.db"
    assert path_of(file_uri(path)) == path
    assert path_of(sqlite_uri(path)) == path


def test_the_addresses_of_common_names_are_those_of_earlier_stores(tmp_path):
    assert sqlite_uri(tmp_path / "mlflow.db") == f"sqlite:///{tmp_path}/mlflow.db"
    assert file_uri(tmp_path / "artifacts") == f"file://{tmp_path}/artifacts"


@named
def test_a_database_is_made_where_its_address_says_and_read_from_there(tmp_path, name):
    from sqlalchemy import create_engine

    database = tmp_path / name / "some.db"
    database.parent.mkdir()
    engine = create_engine(sqlite_uri(database))
    with engine.begin() as connection:
        connection.exec_driver_sql("CREATE TABLE t (x)")
    engine.dispose()
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [database]
    with read_only(database) as reading:
        assert reading.execute("SELECT name FROM sqlite_master").fetchall() == [("t",)]
        with pytest.raises(sqlite3.OperationalError, match="readonly"):
            reading.execute("CREATE TABLE u (x)")


def test_reading_makes_no_database(tmp_path):
    with pytest.raises(sqlite3.OperationalError), read_only(tmp_path / "none.db"):
        pass
    assert not list(tmp_path.iterdir())


def test_a_path_that_no_address_can_hold_is_refused_in_one_line(tmp_path):
    assert path_of(file_uri(tmp_path / NOT_UTF8)) == tmp_path / NOT_UTF8
    with pytest.raises(UserError) as caught:
        sqlite_uri(tmp_path / NOT_UTF8 / "some.db")
    assert caught.value.problem == f"{tmp_path}/a\\udcffb/some.db: no database address can hold this path"
