"""The figures and tables of arms from files."""
