"""Dates and times of day in a table."""

from __future__ import annotations

import re
from datetime import datetime

import numpy as np

_ZONE = re.compile(r"\s*(?:Z|UTC|[-+]\d\d:?\d\d)$")


class Stamp:
    """Dates and times of day as seconds since the first one."""

    def __init__(self) -> None:
        self._first: np.datetime64 | None = None

    def is_time(self, text: str) -> bool:
        """Return True if a text is a date with a time.

        - `text`: an entry.
        """
        return self._moment(text) is not None

    def seconds(self, text: str) -> float:
        """Return the seconds since the first text.

        - `text`: an entry.

        Raises ValueError if a text is no date.
        """
        moment = self._moment(text)
        if moment is None:
            raise ValueError(text)
        if self._first is None:
            self._first = moment
        return float((moment - self._first) / np.timedelta64(1, "ns")) * 1e-9

    def _moment(self, text: str) -> np.datetime64 | None:
        text = text.strip()
        zone = _ZONE.search(text)
        bare = text[: zone.start()] if zone is not None and ":" in text[: zone.start()] else text
        if not re.fullmatch(r"\d{4}[-/]\d\d?[-/]\d\d?[ T_]\d\d?:\d\d(?::\d\d(?:[.,]\d{1,9})?)?", bare):
            return None
        try:
            date, clock = re.split(r"[ T_]", bare.replace("/", "-"), maxsplit=1)
            year, month, day = date.split("-")
            hour, _, rest = clock.replace(",", ".").partition(":")
            moment = np.datetime64(f"{year}-{month:0>2}-{day:0>2}T{hour:0>2}:{rest}", "ns")
            if zone is not None and zone[0].strip() not in ("Z", "UTC"):
                offset = datetime.fromisoformat(f"2000-01-01T00:00{zone[0].strip()}").utcoffset()
                moment = moment - np.timedelta64(int(offset.total_seconds()) if offset else 0, "s")
            return moment
        except ValueError:
            return None
