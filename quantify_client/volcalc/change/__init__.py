"""Change: one surface above another, both measured, and brought together on stable ground."""
