"""How often the hand is right: the tables of docs/depth_reversal.md."""
