"""How the documentation site is made: pages are staged, their code is run, and what came of it is checked."""
