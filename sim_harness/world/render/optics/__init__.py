"""Motion blur, lens, exposure and sensor of the camera."""
