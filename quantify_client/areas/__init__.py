"""Outlines of the areas to be measured, from any file."""
