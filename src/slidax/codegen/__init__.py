"""From a pure JAX function to C99, to machine code and to a CUDA kernel."""
