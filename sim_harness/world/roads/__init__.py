"""Reference lines, lanes, appearance and disturbances of roads."""
