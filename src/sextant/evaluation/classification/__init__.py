"""Errors of classifiers under corruptions."""
