"""The REST API: what requests may ask for, and what they are answered."""
