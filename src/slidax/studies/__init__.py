"""Many runs: what could happen, the worst of it, and the gains that are best for all of it."""
