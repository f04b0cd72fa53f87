"""From sources to measurements: the only place that knows the order of the stages."""
