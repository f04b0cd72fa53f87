"""What all tests share: the same examples on every run."""

from hypothesis import settings

# A red build must be red again when it is run again, on any machine however slow.
settings.register_profile("ci", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("ci")
