"""MLflow, which mirrors the run directories. Nothing else in Sextant imports it, and nothing here does at import."""
