"""What stages need of a disk: whole writes, grey images, PLY, open3d; and words for messages."""
