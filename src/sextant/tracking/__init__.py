"""MLflow, a mirror of the run directories. Only this package imports MLflow, and only when it is used."""
