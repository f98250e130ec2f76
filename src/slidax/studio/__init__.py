"""The studio: a browser workbench on this machine, with Python behind it.

`server.serve` starts the studio; `app.py` has its routes. Simulations run in the workbench process (`bench.py`),
commands as jobs (`jobs.py`). Both kinds of processes can access only the studio's folder (`confined.py`). This file
imports nothing, because these processes give up access to all other files before they import anything.
"""
