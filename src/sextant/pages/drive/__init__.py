"""A browser page of a drive while it is localized: :mod:`~sextant.pages.drive.watch` passes each step to the page."""
