"""The studio: a browser workbench on this machine, with Python behind it.

`server.serve` starts it; `app.py` has its routes. Simulations run in the workbench process (`bench.py`), commands as
jobs (`jobs.py`); both are confined to the studio's folder (`confined.py`). This file imports nothing, because these
processes give up access to all other files before they import anything.
"""
