"""Pictures of COSFIRE filters and of their detections."""
