"""Errors of cameras, their summaries, and what is known of their uncertainty."""
