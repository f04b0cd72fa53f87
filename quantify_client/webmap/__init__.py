"""What only a web map needs: the layers of a measurement, and scale bars clicked on it."""
