"""Reference lines, lanes and what a road looks like."""
