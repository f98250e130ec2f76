"""The figures and measured tables of docs/sampled-data.md and docs/loop-rate.md."""
