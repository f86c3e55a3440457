"""What the demonstration answers: each a function of files that returns plain values, with pictures as data addresses.

No server and no page: these are in :mod:`sextant.pages.demo`.
"""
