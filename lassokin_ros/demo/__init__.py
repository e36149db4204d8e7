"""`make demo`: synthetic motion played into the real node, with a table and a picture."""
