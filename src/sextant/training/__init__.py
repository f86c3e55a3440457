"""Lightning modules, one per task: thin layers over the functional core."""
