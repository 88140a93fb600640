"""The actuator of a CAN bus: a DBC of the user, a map of its signals, python-can and cantools."""
