"""Detection from a single example, by COSFIRE filters."""
