"""Error bound along any motion of an identified arm."""
