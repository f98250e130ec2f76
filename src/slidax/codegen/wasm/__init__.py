"""Compile programs to WebAssembly with LLVM."""

from .module import Module as Module
from .module import wasm_module as wasm_module

__all__ = ["Module", "wasm_module"]
