"""What `lassokin track` finds in videos before it tracks: cuts, turning cameras, offsets."""
