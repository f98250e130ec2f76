"""Every surface: one line here enrols a new one in `tests/laws/test_surfaces.py`."""

from slidax.surfaces import AbstractSurface, SmoothFixedTime

SURFACES: list[tuple[str, AbstractSurface]] = [
    ("smooth_fixed_time_4_1", SmoothFixedTime(k1=0.2, k2=0.6, p=0.5, q=1.2, delta=0.01)),
    ("smooth_fixed_time_wide", SmoothFixedTime(k1=[0.5, 1.0], k2=[0.3, 0.2], p=[0.8, 0.3], q=1.7, delta=[1.0, 0.2])),
]
