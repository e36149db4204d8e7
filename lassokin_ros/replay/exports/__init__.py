"""Motion out, for other tools: one small module for each format, fed by `lassokin_ros.replay.motion.Motion`."""
