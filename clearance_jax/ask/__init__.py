"""Questions to a mechanism at points of its numbers; answered one by one, in batches of lanes, or on a cluster."""
