"""Frame by frame: motions that are carried from one frame to the next."""
