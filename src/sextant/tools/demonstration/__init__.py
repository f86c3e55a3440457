"""The answers of the demonstration: functions of files that return plain values, with pictures as data addresses.

They need no server and no page; those are in :mod:`sextant.pages.demo`.
"""
