"""What following a leader is worth when the lanes are lost, and what the lead detector is worth."""
