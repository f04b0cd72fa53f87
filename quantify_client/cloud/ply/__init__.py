"""PLY: points, and the faces that may join them."""
