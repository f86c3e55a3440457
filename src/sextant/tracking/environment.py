"""Settings of MLflow and Lightning that must be in place before they are imported."""

import logging
import os
import warnings

SETTINGS = {
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "DO_NOT_TRACK": "true",
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "20",
    "MLFLOW_LOGGING_LEVEL": "ERROR",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
}
QUIET = ("alembic", "pytorch_lightning", "lightning_fabric", "matplotlib")


class _ErrorsOnly(logging.Filter):
    """Passes only errors. Unlike a level, it survives the libraries' own set-up of their loggers."""

    def filter(self, record: logging.LogRecord) -> bool:
        return record.levelno >= logging.ERROR


_ERRORS_ONLY = _ErrorsOnly()


def quiet_libraries() -> None:
    """Turn off telemetry, adverts and the libraries' progress bars, and give up early on an unresponsive server.

    Variables that the user has set are kept.
    """
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    for name in QUIET:
        logging.getLogger(name).setLevel(logging.ERROR)
    for name in ("pytorch_lightning.utilities.rank_zero", "lightning_fabric.utilities.rank_zero"):
        logging.getLogger(name).addFilter(_ERRORS_ONLY)
    warnings.filterwarnings("ignore", module=r"pytorch_lightning|lightning|mlflow|torch|torchmetrics")
