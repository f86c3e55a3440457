"""A PostgreSQL on the loopback device, with a database for MLflow."""

import os
import shutil
import socket
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path


def program(name):
    """Where a program of PostgreSQL is; Debian keeps them off the path. None if it is not installed."""
    debian = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return str(debian[-1]) if debian else shutil.which(name)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def running_postgres(folder):
    """Yields the address of an empty database; PostgreSQL does not run as root, so there it runs as its own user."""
    user = "postgres" if os.getuid() == 0 else None
    data, port = Path(folder) / "data", free_port()
    data.mkdir(parents=True)
    if user is not None:
        shutil.chown(data, user)
        for parent in (data, *data.parents):  # a folder of pytest's is for its owner alone
            if parent.stat().st_uid == os.getuid():
                parent.chmod(parent.stat().st_mode | 0o011)
    quiet = {"stdout": subprocess.DEVNULL, "user": user, "cwd": "/"}
    subprocess.run([program("initdb"), "-D", data, "-U", "mlflow", "-A", "trust", "--no-sync"], check=True, **quiet)
    settings = [f"-cport={port}", "-clisten_addresses=127.0.0.1", "-cunix_socket_directories=", "-cfsync=off"]
    with (Path(folder) / "postgres.log").open("wb") as log:
        server = subprocess.Popen(
            [program("postgres"), "-D", data, *settings], stderr=log, start_new_session=True, **quiet
        )
    try:
        ask = [program("psql"), "-h", "127.0.0.1", "-p", str(port), "-U", "mlflow", "-d", "postgres", "-qc"]
        deadline = time.monotonic() + 60
        while subprocess.run([*ask, "CREATE DATABASE mlflow"], capture_output=True, check=False).returncode:
            assert server.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.2)
        yield f"postgresql+psycopg2://mlflow@127.0.0.1:{port}/mlflow"
    finally:
        server.terminate()
        server.wait()
