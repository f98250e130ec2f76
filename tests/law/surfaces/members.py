"""Every surface: one line here enrols a new one in `tests/laws/test_surfaces.py`. All are for two joints."""

from slidax.law import AbstractSurface, Linear, LinearCoreFixedTime, SingularityFree, SmoothFixedTime

SURFACES: list[tuple[str, AbstractSurface]] = [
    ("smooth_fixed_time_4_1", SmoothFixedTime(k1=0.2, k2=0.6, p=0.5, q=1.2, delta=0.01)),
    ("smooth_fixed_time_wide", SmoothFixedTime(k1=[0.5, 1.0], k2=[0.3, 0.2], p=[0.8, 0.3], q=1.7, delta=[1.0, 0.2])),
    ("linear_core_4_1", LinearCoreFixedTime(k1=1.5, k2=1.0, p=0.5, q=1.2, delta=0.01)),
    ("linear_core_wide", LinearCoreFixedTime(k1=[0.5, 1.0], k2=0.3, p=[0.8, 0.3], q=1.7, delta=[1.0, 0.2])),
    ("singularity_free_4_2", SingularityFree(c1=2.0, c2=2.0, alpha=0.7, beta=1.9, r=1.7, delta=0.3)),
    ("singularity_free_narrow", SingularityFree([1.0, 2.0], [0.5, 0.2], [0.7, 0.4], 1.2, [1.7, 2.5], [0.01, 2.0])),
    ("linear", Linear(rate=[5.0, 2.0])),
]

LIKE_OTHERS = ("smooth_fixed_time_4_1", "linear_core_4_1", "singularity_free_narrow")
"""The same classes with other numbers: these run in the long version."""
