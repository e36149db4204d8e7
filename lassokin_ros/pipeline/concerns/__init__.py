"""What may be wrong, with the words and the advice for each: see `catalogue.py`."""
