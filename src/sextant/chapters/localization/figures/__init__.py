"""Pictures of particles, maps and trajectories."""
