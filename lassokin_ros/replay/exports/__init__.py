"""Export motion to the file formats of other tools. One module per format writes a `replay.motion.Motion`."""
