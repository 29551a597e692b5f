"""What of each frame is specimen: given masks, writing, background, what does not move."""
