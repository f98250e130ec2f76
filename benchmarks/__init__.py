"""What `make bench` measures. Times depend on the machine, so they are written down, never asserted."""
