"""Shared parts of the Lightning modules of several chapters: optimisers, schedules, losses by step, processes."""
