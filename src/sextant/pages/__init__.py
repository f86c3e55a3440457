"""Browser pages, served to this machine only: :mod:`~sextant.pages.demo`, and a drive while it is localized."""
