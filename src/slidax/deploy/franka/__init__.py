"""The law on a Franka arm: a program around libfranka in C++, and the same for pylibfranka."""

from .export import export_franka as export_franka
