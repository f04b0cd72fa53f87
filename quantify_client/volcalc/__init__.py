"""Points to volume: the paper's slices, and terrain above a base."""
