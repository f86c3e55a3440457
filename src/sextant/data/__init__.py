"""Datasets, one file per family, and the batches made from them."""
