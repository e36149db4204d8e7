"""Methods that the tracker is compared with."""
