"""The figures and tables of docs/learning.md."""
