"""What the verbs of the command line share: their table and common options."""
