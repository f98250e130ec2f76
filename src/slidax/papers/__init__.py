"""Published examples, computed again and laid beside what was printed. One package per paper."""
