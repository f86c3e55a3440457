"""Detection of what one example shows, by COSFIRE filters."""
