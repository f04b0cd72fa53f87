"""What runs in WebODM's worker: one measurement after the other."""
