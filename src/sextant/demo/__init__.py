"""The demonstration: a page in the browser, and a server on this machine alone that answers it.

:mod:`sextant.demo.questions` says what can be asked, :mod:`~sextant.demo.answers` answers it for files that were sent,
:mod:`~sextant.demo.app` is the server without a port, and :mod:`~sextant.demo.serving` gives it one. The page is
``page.html``; it loads nothing from anywhere else.
"""
