"""Trained networks loaded from their files, whoever wrote them. Imports neither Hydra nor Lightning."""
