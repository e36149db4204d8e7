"""Files with the keypoints of other programs as sources of `lassokin track`: one reader for each kind, one type."""
