"""Control files: what was observed."""
