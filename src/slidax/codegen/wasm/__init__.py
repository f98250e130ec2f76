"""Compile programs to WebAssembly with LLVM, for a page in a browser and other hosts."""

from .module import Module as Module
from .module import wasm_module as wasm_module
