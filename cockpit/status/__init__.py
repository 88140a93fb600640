"""The state of running drives, and drives as services of systemd."""
