"""Pictures of place recognition."""
