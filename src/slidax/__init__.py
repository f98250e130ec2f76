"""Sliding-mode control of robot arms in JAX."""
