"""The law on microcontrollers: a Makefile for cross compilers, and the golden test in emulators or on a board."""

from .export import TARGETS as TARGETS
from .export import export_micro as export_micro
