"""What the controller learns while driving: steering offset, understeer, steering delay."""
