"""Damaged inputs of every kind, given to the real command; ``run.py`` says how to start it."""
