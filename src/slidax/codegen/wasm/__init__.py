"""WebAssembly from programs, by LLVM: for a page in a browser, and for whatever else runs it."""

from .module import Module as Module
from .module import wasm_module as wasm_module

__all__ = ["Module", "wasm_module"]
