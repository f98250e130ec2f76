"""Entry point of `python -m slidax`, for environments in which the command `slidax` is not on the path."""

from slidax.cli.app import main

if __name__ == "__main__":
    main()
