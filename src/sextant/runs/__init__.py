"""Run directories, the authoritative record of runs. MLflow is a mirror of them."""
