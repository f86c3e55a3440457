"""The demonstration: a browser page and its server, which only this machine can reach.

:mod:`~sextant.pages.demo.answers` lists the questions and answers them for uploaded files;
:mod:`~sextant.pages.demo.app` is the WSGI application and serves it on a port. The page is ``page.html``; it loads
nothing from other hosts.
"""
