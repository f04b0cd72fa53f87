"""The adjustment of everything observed, and the similarity transform that it gives."""
