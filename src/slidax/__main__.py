"""`python -m slidax`, where the command itself is not on the path."""

from slidax.cli.app import main

if __name__ == "__main__":
    main()
