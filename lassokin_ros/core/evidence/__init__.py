"""The evidence of a frame's lasso, one class per file.

`evidence` defines the interface; `frame_model` assembles the rows of all evidence for a frame.
"""
