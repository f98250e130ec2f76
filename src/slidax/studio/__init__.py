"""The studio: the playground's page on this machine, with Python behind it.

`server.serve` serves it. Nothing is imported here: its processes give up all other files before they import anything.
"""
