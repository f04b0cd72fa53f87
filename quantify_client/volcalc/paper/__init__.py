"""The paper's slices, kept as the reference: ``--method polar``."""
