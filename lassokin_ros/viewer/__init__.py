"""The node `viewer`: the tracker's topics in the viewer Rerun."""
