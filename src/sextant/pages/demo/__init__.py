"""The demonstration: a page in the browser, and a server on this machine only that answers it.

:mod:`~sextant.pages.demo.answers` lists what can be asked, and :mod:`~sextant.pages.demo.answers` answers it for
uploaded files. :mod:`~sextant.pages.demo.app` is the server without a port, and :mod:`~sextant.pages.demo.app`
gives it one. The page is ``page.html``; it loads nothing from anywhere else.
"""
