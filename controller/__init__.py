"""Decision and vehicle state to command: where the wheel goes, how hard to push or brake, and what is forbidden."""
