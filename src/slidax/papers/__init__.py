"""Published examples, computed again and compared with what was printed. One package per paper."""
