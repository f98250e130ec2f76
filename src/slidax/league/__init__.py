"""A league: schemes on common tasks, tuned alike on some cases, and judged by others that they have not seen."""
