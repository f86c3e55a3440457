"""Addresses (URIs) of files and databases: the only module that converts between them and paths.

A path must never be pasted into an address, where ``?``, ``#`` and ``%`` have a meaning.
"""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import unquote_to_bytes, urlsplit

from sextant.errors import UserError

SQLITE = "sqlite"


def file_uri(path: Path) -> str:
    """The address ``file://..`` of a file or folder.

    >>> file_uri(Path("/runs/q?x 100%"))
    'file:///runs/q%3Fx%20100%25'
    """
    return path.absolute().as_uri()


def sqlite_uri(database: Path) -> str:
    """The address of a database for SQLAlchemy, and so for MLflow and Optuna.

    >>> sqlite_uri(Path("/runs/q?x/mlflow.db"))
    'sqlite+pysqlite:////runs/q%3Fx/mlflow.db'

    Raises:
        UserError: the installed SQLAlchemy has no address for the path. No version has one for names that are not
            UTF-8; versions before 2.1 have none for names with a question mark.
    """
    from sqlalchemy.engine import URL, make_url

    path = str(database.absolute())
    try:
        address = URL.create(SQLITE, database=path).render_as_string()
        if make_url(address).database == path:
            # by the plain scheme, MLflow would also make a folder of the undecoded name
            return address if address.endswith(path) else address.replace(SQLITE, f"{SQLITE}+pysqlite", 1)
    except UnicodeEncodeError:
        pass
    shown = path.encode(errors="backslashreplace").decode()
    raise UserError(
        f"{shown}: no database address can hold this path",
        "Rename the folder, or choose another: paths.outputs=<folder>, or SEXTANT_OUTPUTS.",
    )


def path_of(uri: str) -> Path:
    """The path in an address made by :func:`file_uri` or :func:`sqlite_uri`.

    >>> path_of("file:///runs/q%3Fx%20100%25").as_posix()
    '/runs/q?x 100%'
    """
    if uri.startswith(SQLITE):
        from sqlalchemy.engine import make_url

        return Path(str(make_url(uri).database))
    return Path(unquote_to_bytes(urlsplit(uri).path).decode(errors="surrogateescape"))


@contextmanager
def read_only(database: Path) -> Iterator[sqlite3.Connection]:
    """A connection to an SQLite database that can neither change nor create it.

    Raises:
        sqlite3.Error: there is no such file, or it is not a database.
    """
    with closing(sqlite3.connect(f"{file_uri(database)}?mode=ro", uri=True, timeout=5)) as connection:
        yield connection
