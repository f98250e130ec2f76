"""The studio: the playground's page on this machine, with Python behind it.

`server.serve` serves it; it is imported when it is needed, as its packages are an extra.
"""

from .needed import require_studio as require_studio
