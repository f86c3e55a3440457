"""What the Lightning modules of several chapters share: optimisers, schedules, losses by step, processes."""
