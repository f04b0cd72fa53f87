"""Stockpiles found in the heights of a whole cloud, with what else stands on the ground."""
