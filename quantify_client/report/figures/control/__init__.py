"""Figures of control and its adjustment."""
