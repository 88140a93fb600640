"""The live page of a drive: what the car sees and does, why, a stop button, and the rules while it drives."""
