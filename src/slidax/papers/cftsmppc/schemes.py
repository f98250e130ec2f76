"""The schemes of the paper, and what it leaves open about each of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Reading = Literal["stated", "off"]


@dataclass(frozen=True)
class Scheme:
    """A scheme as the paper's examples use it.

    - `key`, `name`: in scenario files, and in the paper.
    - `listed`, `other`: half-width of the boundary layer as its table lists it (0 where it lists none), and another one
      to try.
    - `path`: where scenario files keep it.
    - `band`: settling band at which the printed times are compared, rad or m; the paper prints none.
    - `nearest`: the reading of the disturbance that comes nearer to the printed row.
    """

    key: str
    name: str
    listed: float
    other: float
    path: str = "scheme.reaching.layer"
    band: float = 1e-3
    nearest: Reading = "stated"

    def called(self, layer: float | None) -> str:
        """The name with the boundary layer, where it is not the listed one.

        - `layer`: half-width; None for the listed one.
        """
        if layer is None or layer == self.listed:
            return self.name
        return f"{self.name}, sign" if layer == 0.0 else f"{self.name}, layer {layer:g}"


PROPOSED = "cftsmppc"
SCHEMES: dict[str, Scheme] = {
    scheme.key: scheme
    for scheme in (
        Scheme(PROPOSED, "CFTSMPPC", 0.05, 0.0, band=1e-8, nearest="off"),
        Scheme("ftsmppc", "FTSMPPC", 0.05, 0.0),
        Scheme("ftsmc", "FTSMC", 0.0, 0.05),
        Scheme("nftsmc", "NFTSMC", 0.0, 3e-4, path="scheme.layer", band=1e-4),
        Scheme("anftsmc", "ANFTSMC", 0.0, 1e-3, path="scheme.layer", band=1e-5, nearest="off"),
        Scheme("sfsmc", "SFSMC", 0.0, 0.05, band=1e-4),
    )
}
COMPARED: dict[str, tuple[str, ...]] = {
    "4.1": (PROPOSED, "ftsmppc", "ftsmc"),
    "4.2": (PROPOSED, "nftsmc", "anftsmc", "sfsmc"),
}
"""Which schemes each example compares, the proposed one first."""
