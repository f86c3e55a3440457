"""Errors of predicted cameras, their summaries, and their uncertainty."""
