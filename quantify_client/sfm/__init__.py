"""Photographs -> OpenDroneMap outputs; for now, what an output holds (:mod:`.outputs`)."""
