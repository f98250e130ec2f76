"""The exported step for a very long time: what it keeps, and how many instructions its longest steps take.

python -m benchmarks.long_run [--steps 1e8] [--count 1e6] [SCENARIO...]
"""
