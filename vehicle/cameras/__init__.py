"""Camera sources: frames, stamped when they were captured."""
