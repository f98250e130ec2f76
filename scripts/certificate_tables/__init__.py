"""The measured tables of docs/certificates."""
