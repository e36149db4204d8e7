"""What is derived from the solved state: smoothed pose, fixed lag, uncertainty, failure probability."""
