"""Recorded drives in the formats of other tools: tables, video, figures, tubs of donkeycar."""
