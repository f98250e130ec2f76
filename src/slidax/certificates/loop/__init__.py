"""The loops of the joints at the arm's own rate: what of the error is certain, for all arms of a set."""
