"""The studio: a browser workbench on this machine, with Python behind it.

`server.serve` starts the studio; `app.py` has its routes. Simulations run in the workbench process (`bench.py`),
commands as jobs (`jobs.py`). Of the user's files, both kinds of processes can access only those in the studio's folder
(`confined.py`). This file imports nothing, because these processes give up their access to other files before they
import anything else.
"""
