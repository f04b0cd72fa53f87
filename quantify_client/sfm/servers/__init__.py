"""NodeODM, ClusterODM and WebODM servers."""
