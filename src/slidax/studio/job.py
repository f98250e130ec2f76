"""Process in which the studio, the local web page of `slidax studio`, runs a command."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from importlib import import_module
from pathlib import Path


def main() -> None:
    """Run a slidax command; exit with 2 if one of its files refers to a file outside the working directory.

    The first argument is a JSON object:

    - `files`: names of the scenario or study files that the command reads.
    - `changes`: new values of the scenario, by dotted path such as `sensor.delay`.
    - `module`: Python module whose `main` runs the command.
    - `words`: arguments of the command line.
    - `interruptible`: True if the command saves its results on SIGINT.
    """
    end_with_the_server()
    request = json.loads(sys.argv[1])
    from slidax.core.errors import DefinitionError

    from .files import Folder
    from .references import require_beneath, require_file_beneath

    folder = Folder(Path.cwd())
    try:
        for name in request["files"]:
            require_file_beneath(folder, folder.resolve(name))
        require_beneath(folder, request["changes"], folder.root)
    except DefinitionError as error:
        print(f"slidax: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    if request["interruptible"]:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = ["slidax", *request["words"]]
    import_module(request["module"]).main()


def end_with_the_server() -> None:
    """End this process and its children when standard input ends, that is, when the server has ended."""

    def wait() -> None:
        while os.read(0, 4096):
            pass
        if sys.platform != "win32":
            os.killpg(0, signal.SIGKILL)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
