"""The main job: every process over Zenoh, watched and summed up."""
