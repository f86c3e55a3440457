"""Lightning modules, one a task; thin over the functional core."""
