"""A command of slidax as a job of the studio, in a process of its own, confined before this module is imported."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from importlib import import_module
from pathlib import Path


def main() -> None:
    """Runs the command that the first argument says, unless a file that it reads names one outside of the folder.

    The argument is JSON: `files` that are read, `changes` by path, the `module` with the command line, its `words`, and
    whether it is `interruptible`: keeps what it has when it is interrupted.
    """
    end_with_the_server()
    asked = json.loads(sys.argv[1])
    from slidax._errors import DefinitionError

    from .folder import Folder
    from .references import require_beneath, require_file_beneath

    folder = Folder(Path.cwd())
    try:
        for name in asked["files"]:
            require_file_beneath(folder, folder.place(name))
        require_beneath(folder, asked["changes"], folder.root)
    except DefinitionError as error:
        print(f"slidax: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    if asked["interruptible"]:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = ["slidax", *asked["words"]]
    import_module(asked["module"]).main()


def end_with_the_server() -> None:
    """Ends this process and its children once standard input does, to which nobody writes: the server is gone."""

    def wait() -> None:
        while os.read(0, 4096):
            pass
        if sys.platform != "win32":
            os.killpg(0, signal.SIGKILL)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
