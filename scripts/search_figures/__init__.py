"""The figures and tables of docs/searches.md."""
