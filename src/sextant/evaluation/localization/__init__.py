"""Success, errors and posteriors of localization."""
