"""A drive in the browser while it is localized: :mod:`~sextant.pages.drive.watch` passes each step to the page."""
