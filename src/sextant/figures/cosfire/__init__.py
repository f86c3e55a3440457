"""Pictures of COSFIRE filters and of what they find."""
