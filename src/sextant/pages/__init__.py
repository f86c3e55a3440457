"""Pages in the browser, served on this machine alone: :mod:`~sextant.pages.demo`, and a drive as it is localized."""
