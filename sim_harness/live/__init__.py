"""`trepid drive`: every process over Zenoh, monitored and evaluated."""
