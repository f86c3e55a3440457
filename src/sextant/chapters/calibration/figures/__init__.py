"""Pictures of cameras and of their errors."""
