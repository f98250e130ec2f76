"""The command line. `app.py` lists all commands; each other file has the commands of one topic."""

from .app import app as app
from .app import main as main
