"""Networks that steer as recorded, on real drives: how far they are from the driver."""
