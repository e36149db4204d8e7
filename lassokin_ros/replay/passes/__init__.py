"""The passes over a recording whose later frames are known, see `lassokin_ros.core.recording`."""
