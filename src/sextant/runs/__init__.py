"""Run directories: where the truth about a run lies. MLflow is a mirror of them."""
