"""Pages in the browser, served on this machine only: :mod:`~sextant.pages.demo`, and a drive as it is localized."""
