"""WebAssembly from programs, by LLVM: for a page in a browser, and for whatever else runs it."""

from .module import COLUMNS as COLUMNS
from .module import Module as Module
from .module import wasm_module as wasm_module

__all__ = ["COLUMNS", "Module", "wasm_module"]
