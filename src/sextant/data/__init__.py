"""Datasets, one file a family, and the batches that are made of them."""
