"""Files: how they are read whole, recognised, written and replaced."""
