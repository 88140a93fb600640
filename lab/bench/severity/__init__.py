"""Fear over the severity of disturbances and faults: ``trepid bench fear-severity``."""
