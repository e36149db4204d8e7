"""`make demo`: play synthetic motion into the real node; print a table, draw a picture."""
